//! Writes the files of a campus: `map.pddl` and `campus.toml`.
//!
//! ```text
//! cargo run -p building --example campus -- SEED HOUSES MAP.pddl ECOSYSTEM.toml
//! ```
//!
//! The domain file must lie beside the map. The ecosystem file names both by paths relative to the folder
//! of the ecosystem file.

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

/// Returns `path` relative to the folder of the file `from`. `path` and `from` are relative to the same
/// folder. If either of them is absolute, returns `path` as it is.
fn seen_from(from: &Path, path: &Path) -> PathBuf {
    let folder = from.parent().unwrap_or(Path::new(""));
    if path.is_absolute() || folder.is_absolute() {
        return path.to_owned();
    }
    let above = folder.components().filter(|part| matches!(part, Component::Normal(_)));
    above.map(|_| Component::ParentDir).collect::<PathBuf>().join(path)
}
