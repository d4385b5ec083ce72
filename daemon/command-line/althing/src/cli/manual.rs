//! Writes the manual pages of packages, one per command. A test does it, so that the programs have
//! no part for it:
//!
//! ```sh
//! ALTHING_MANUAL=target/manual cargo test --workspace --bin althing manual
//! ```

use std::path::{Path, PathBuf};

use clap::{Command, CommandFactory as _};
use clap_mangen::Man;

use super::Cli;

/// Name of the variable with the folder that the pages are written to.
const FOLDER: &str = "ALTHING_MANUAL";

/// File of the page of the planner.
const PLANNER: &str = "althing-plan.1";

/// A manual page with the name of its file.
struct ManualPage {
    file: String,
    text: Vec<u8>,
}

/// Adds the pages of a command, which is typed as `words`, and of the commands below it.
fn pages(command: &Command, words: &[&str], pages: &mut Vec<ManualPage>) {
    let name = words.join("-");
    let named = command.clone().display_name(name.clone()).bin_name(words.join(" "));
    let mut text = Vec::new();
    Man::new(named).render(&mut text).expect("memory has room");
    pages.push(ManualPage { file: format!("{name}.1"), text });
    for below in command.get_subcommands().filter(|below| below.get_name() != "help") {
        self::pages(below, &[words, &[below.get_name()]].concat(), pages);
    }
}

/// Returns the pages of the daemon, and that of the planner. `althing plan` has none: its page would
/// have the name of the planner's, which belongs to another package.
fn all() -> [(&'static str, Vec<ManualPage>); 2] {
    let (mut daemon, mut planner) = (Vec::new(), Vec::new());
    pages(&Cli::command(), &["althing"], &mut daemon);
    daemon.retain(|page| page.file != PLANNER);
    let command = Command::new("althing-plan").about("Find a plan for a PDDL domain and problem");
    let command = <althing_plan::arguments::PlanArgs as clap::Args>::augment_args(command);
    let command = command.after_help(althing_plan::arguments::help("althing-plan"));
    pages(&command, &["althing-plan"], &mut planner);
    [("daemon", daemon), ("planner", planner)]
}

#[test]
fn every_command_has_a_manual_page() {
    let all = all();
    let [(_, daemon), (_, planner)] = &all;
    for command in ["", "-up", "-goal", "-backup", "-restore", "-people-add"] {
        let file = format!("althing{command}.1");
        let page = daemon.iter().find(|page| page.file == file).expect("each command has a page");
        let text = String::from_utf8_lossy(&page.text);
        assert!(text.contains(".TH "), "{file}: {text}");
        assert!(text.contains(".SH SYNOPSIS"), "{file}: {text}");
    }
    assert_eq!(planner.iter().map(|page| page.file.as_str()).collect::<Vec<_>>(), [PLANNER]);
    let Some(folder) = std::env::var_os(FOLDER).map(PathBuf::from) else { return };
    for (name, pages) in &all {
        write(&folder.join(name), pages);
    }
}

fn write(folder: &Path, pages: &[ManualPage]) {
    // Relative to the workspace, as the commands of the other files of a release are.
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../..");
    let folder = root.join(folder);
    std::fs::create_dir_all(&folder).expect("the folder can be made");
    for page in pages {
        std::fs::write(folder.join(&page.file), &page.text).expect("the folder has room");
    }
}
