//! An ONVIF device for trying things by hand: prints its address, and runs until Ctrl-C. Its user
//! is `admin` with the password `admin`, and its presets are `Home` and `Door`.
//!
//! With an IP address of this machine as its argument, it is there for the network, and answers
//! WS-Discovery; without one, it is there for this machine only.

use oxvif::mock::MockServer;

#[tokio::main]
async fn main() -> std::io::Result<()> {
    let mut builder = MockServer::builder().enforce_auth(true);
    if let Some(ip) = std::env::args().nth(1) {
        let ip = ip.parse().map_err(std::io::Error::other)?;
        let scopes = ["type/ptz", "name/Hall%20Camera", "hardware/IPC-42"];
        let scopes = scopes.map(|scope| format!("onvif://www.onvif.org/{scope}"));
        builder = builder.bind_ip(ip).discoverable(scopes.to_vec());
    }
    let server = builder.start().await?;
    println!("{}", server.device_url());
    tokio::signal::ctrl_c().await?;
    server.shutdown().await
}
