//! Writes the files of a campus: `map.pddl` and `campus.toml`.
//!
//! ```text
//! cargo run -p building --example campus -- SEED HOUSES MAP.pddl ECOSYSTEM.toml
//! ```
//!
//! The domain file must be beside the map. The ecosystem file refers to both by paths relative to
//! its own folder.

use std::error::Error;
use std::path::{Component, Path, PathBuf};
use std::{env, fs};

use building::Campus;

const USAGE: &str = "usage: campus SEED HOUSES MAP.pddl ECOSYSTEM.toml";

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [seed, houses, map, ecosystem] = arguments.as_slice() else { return Err(USAGE.into()) };
    let campus = Campus::seeded(seed.parse()?, houses.parse()?);
    let seen = seen_from(Path::new(ecosystem), Path::new(map));
    let domain = seen.with_file_name("domain.pddl");
    fs::write(map, campus.map())?;
    fs::write(
        ecosystem,
        campus.ecosystem(&domain.display().to_string(), &seen.display().to_string()),
    )?;
    println!("{} devices: {map}, {ecosystem}", campus.layout().devices().len());
    Ok(())
}

/// Returns `path` relative to the folder of the file `from`, if both paths are relative to the same
/// folder. Returns `path` unchanged if one of them is absolute.
fn seen_from(from: &Path, path: &Path) -> PathBuf {
    let folder = from.parent().unwrap_or(Path::new(""));
    if path.is_absolute() || folder.is_absolute() {
        return path.to_owned();
    }
    let above = folder.components().filter(|part| matches!(part, Component::Normal(_)));
    above.map(|_| Component::ParentDir).collect::<PathBuf>().join(path)
}
