//! The help of `althing`: all commands, by their purpose, one on a line.
//!
//! A command without a line in [`GROUPS`] stands under “More” with the first line of its own help,
//! so that none is missing.

use clap::CommandFactory as _;

use super::Cli;

const HEAD: &str = "\
Althing: the sensors, robots, screens and people of a building plan together.
Usage: althing COMMAND [OPTIONS]     `althing help COMMAND` explains a command
";

const FOOT: &str = "
Options: -v, -vv (log more), --json (output for programs), -h, -V
Documents: README.md, docs/
";

/// Columns before the name of a command, and before what it does.
const GROUP_COLUMNS: usize = 9;
const COMMAND_COLUMNS: usize = 12;

/// Number of columns of a terminal.
const COLUMNS: usize = 80;

/// The commands by purpose, each with what it does, for people who see them the first time.
const GROUPS: &[(&str, &[(&str, &str)])] = &[
    ("Stop", &[("stop", "everything, or a room, or a robot; --release goes on")]),
    (
        "Begin",
        &[
            ("init", "write the ecosystem file of your building, by questions"),
            ("add", "a room, a door, an agent or a goal to the file"),
            ("scenario", "play one of the paper's buildings, without any device"),
            ("up", "run the daemon: this machine's agents join the ecosystem"),
            ("check", "find mistakes in files, and what a building lacks"),
            ("doctor", "what is wrong here, and the command that mends it"),
        ],
    ),
    (
        "Ask",
        &[
            ("goal", "for an outcome: follow it, keep it, cancel it"),
            ("act", "for one action of one agent"),
            ("answer", "a question that an agent asks you"),
            ("set", "change what is known"),
            ("mode", "who plans: one agent for all, or each for itself"),
            ("keyboard", "all of that at a prompt, with completion"),
        ],
    ),
    (
        "Look",
        &[
            ("goals", "what is wanted, and how it stands"),
            ("agents", "who is here, and what they can do"),
            ("state", "what is known, and who says so"),
            ("view", "all of that on a screen, live or from a recording"),
            ("why", "what caused it: a person, a sensor, a failure"),
            ("history", "what happened, and when something last worked"),
            ("watch", "the messages, as they are sent"),
            ("mailbox", "how full the agents' mailboxes are"),
            ("domain", "what all can do together, as PDDL"),
        ],
    ),
    (
        "Devices",
        &[
            ("sensors", "the sensors of this machine, and the lines that add them"),
            ("plugin", "programs that bring agents: check, add, list, allow"),
            ("robot", "record the place where a robot stands"),
        ],
    ),
    (
        "Manage",
        &[
            ("people", "who may do what: add, change, remove, tokens"),
            ("cert", "keys and certificates of the daemons"),
            ("backup", "everything that must outlive the machine"),
            ("restore", "a backup"),
            ("replay", "a recording, in a new ecosystem"),
            ("send", "one message, as it is written"),
            ("completions", "make a shell complete commands"),
        ],
    ),
    (
        "Planner",
        &[
            ("plan", "find a plan for a PDDL domain and problem"),
            ("joint", "the same for agents with secrets, a daemon for each"),
            ("validate", "check a plan, up to the step that fails"),
        ],
    ),
];

/// Returns the help: the commands that this program has, by their purpose.
pub(super) fn text() -> String {
    let command = Cli::command();
    let has = |name: &str| command.find_subcommand(name).is_some();
    let mut text = HEAD.to_owned();
    for (group, commands) in GROUPS {
        let present: Vec<_> = commands.iter().filter(|(name, _)| has(name)).copied().collect();
        add_group(&mut text, group, &present);
    }
    let is_listed =
        |name: &str| GROUPS.iter().any(|(_, all)| all.iter().any(|(listed, _)| *listed == name));
    let others: Vec<(String, String)> = command
        .get_subcommands()
        .filter(|it| !is_listed(it.get_name()) && !it.is_hide_set())
        .map(|it| (it.get_name().to_owned(), it.get_about().map(ToString::to_string)))
        .map(|(name, about)| (name, about.unwrap_or_default()))
        .collect();
    let others: Vec<_> =
        others.iter().map(|(name, about)| (name.as_str(), about.as_str())).collect();
    add_group(&mut text, "More", &others);
    text + FOOT
}

/// Adds the lines of a group; nothing if it has no commands.
fn add_group(text: &mut String, group: &str, commands: &[(&str, &str)]) {
    for (index, (name, about)) in commands.iter().enumerate() {
        let title = if index == 0 { group } else { "" };
        let blank = if index == 0 { "\n" } else { "" };
        let line = format!("{title:<GROUP_COLUMNS$}{name:<COMMAND_COLUMNS$} {about}");
        let cut: String = line.chars().take(COLUMNS).collect();
        *text += &format!("{blank}{}\n", cut.trim_end());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_help_names_every_command_once_and_fits_a_terminal() {
        let text = text();
        for command in Cli::command().get_subcommands() {
            let name = command.get_name();
            let is_it = |line: &&str| line.split_whitespace().any(|word| word == name);
            let column = |line: &&str| {
                line.get(GROUP_COLUMNS..)
                    .is_some_and(|rest| rest.split_whitespace().next() == Some(name))
            };
            assert_eq!(text.lines().filter(is_it).filter(column).count(), 1, "{name}: {text}");
        }
        for line in text.lines() {
            assert!(line.chars().count() <= COLUMNS, "{line}");
        }
    }

    #[test]
    fn what_a_command_does_is_never_cut() {
        for (name, about) in GROUPS.iter().flat_map(|(_, commands)| *commands) {
            let columns = GROUP_COLUMNS + COMMAND_COLUMNS + 1 + about.chars().count();
            assert!(columns <= COLUMNS && name.len() <= COMMAND_COLUMNS, "{name}: {about}");
        }
    }
}
