//! Writes the ecosystem file of a campus.
//!
//! ```text
//! cargo run -p building --example campus -- SEED HOUSES ECOSYSTEM.toml
//! ```

use std::error::Error;
use std::{env, fs};

use building::Campus;

const USAGE: &str = "usage: campus SEED HOUSES ECOSYSTEM.toml";

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [seed, houses, ecosystem] = arguments.as_slice() else { return Err(USAGE.into()) };
    let campus = Campus::seeded(seed.parse()?, houses.parse()?);
    fs::write(ecosystem, campus.ecosystem())?;
    println!("{} devices: {ecosystem}", campus.layout().devices().len());
    Ok(())
}
