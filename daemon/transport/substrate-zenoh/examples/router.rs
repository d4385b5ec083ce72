//! A plain Zenoh router without any code of Althing: the same as `zenohd -c FILE` without plugins.
//! It can stand between daemons that cannot connect to each other.
//!
//! ```text
//! cargo run --release -p substrate-zenoh --example router -- FILE.json5
//! ```
//!
//! The program prints the endpoints on which it listens, and runs until its standard input ends.

use std::error::Error;

use zenoh::{Config, Wait as _};

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    let file = std::env::args().nth(1).ok_or("name a file with Zenoh's settings")?;
    let mut config = Config::from_file(file)?;
    config.insert_json5("mode", "\"router\"")?;
    let session = zenoh::open(config).await?;
    let locators = session.info().locators().wait();
    let locators: Vec<_> = locators.iter().map(ToString::to_string).collect();
    println!("router {} listens on {}", session.zid(), locators.join(" "));
    tokio::io::copy(&mut tokio::io::stdin(), &mut tokio::io::sink()).await?;
    session.close().await
}
