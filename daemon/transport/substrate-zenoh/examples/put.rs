//! A plain Zenoh program without any checks: it publishes a number of bytes under a key that has a
//! subscriber. Tests use it to send messages that no daemon would send.
//!
//! ```text
//! cargo run --release -p substrate-zenoh --example put -- FILE.json5 KEY BYTES
//! ```
//!
//! The program prints a line when the bytes are sent, and runs until its standard input ends.

use std::error::Error;
use std::time::Duration;

use zenoh::{Config, qos::CongestionControl};

/// How long the program waits for a subscriber.
const HEARD_WITHIN: Duration = Duration::from_secs(20);

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    let [file, key, bytes] = &arguments[..] else {
        return Err("name a file with Zenoh's settings, a key and a number of bytes".into());
    };
    let session = zenoh::open(Config::from_file(file)?).await?;
    let publisher = session.declare_publisher(key.clone());
    let publisher = publisher.congestion_control(CongestionControl::Block).await?;
    let changes = publisher.matching_listener().await?;
    let is_heard = async {
        while !publisher.matching_status().await?.matching() {
            changes.recv_async().await?;
        }
        Ok::<_, Box<dyn Error + Send + Sync>>(())
    };
    tokio::time::timeout(HEARD_WITHIN, is_heard).await.map_err(|_| "no session listens")??;
    publisher.put(vec![b'x'; bytes.parse()?]).await?;
    println!("put {bytes} bytes at {key}");
    tokio::io::copy(&mut tokio::io::stdin(), &mut tokio::io::sink()).await?;
    session.close().await
}
