//! An ONVIF device for trying things by hand: prints its address, and runs until Ctrl-C. Its user is
//! `admin` with the password `admin`, and its presets are `Home` and `Door`.

use oxvif::mock::MockServer;

#[tokio::main]
async fn main() -> std::io::Result<()> {
    let server = MockServer::builder().enforce_auth(true).start().await?;
    println!("{}", server.device_url());
    tokio::signal::ctrl_c().await?;
    server.shutdown().await
}
