//! The command line: the commands and their arguments. What each command does is in
//! [`crate::commands`].
//!
//! The help of all commands is in [`help`]. Without arguments, `althing` prints the first screen
//! instead, which [`crate::commands`] makes.

pub(crate) mod backup;
pub(crate) mod cert;
pub(crate) mod doctor;
pub(crate) mod edit;
mod help;
pub(crate) mod history;
pub(crate) mod joint;
#[cfg(test)]
mod manual;
pub(crate) mod people;
pub(crate) mod plugin;
pub(crate) mod robot;
pub(crate) mod stop;
pub(crate) mod times;
pub(crate) mod view;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use althing_plan::arguments::PlanArgs;
use clap::{ArgAction, ArgGroup, Args, CommandFactory as _, Parser, Subcommand, ValueEnum};
use terminal::arguments::{PrintArgs, seconds};
use terminal::exit;

/// The whole command line.
#[derive(Debug, Parser)]
#[command(
    name = "althing",
    version,
    about = "The assembly of all things",
    max_term_width = 80,
    disable_help_flag = true,
    disable_version_flag = true,
    subcommand_required = true
)]
pub(crate) struct Cli {
    /// Log events to stderr, with -vv in detail (the variable ALTHING_LOG filters them)
    #[arg(short, long, action = ArgAction::Count, global = true, display_order = 900)]
    pub(crate) verbose: u8,

    /// Show goals and facts as PDDL, not in words (as the variable ALTHING_PDDL=1 does)
    #[arg(long, global = true, display_order = 898)]
    pub(crate) pddl: bool,

    /// The language of goals and facts: en or de [default: that of LC_ALL, LC_MESSAGES or LANG]
    #[arg(long, value_name = "LANG", value_parser = language, global = true, display_order = 899)]
    pub(crate) language: Option<phrases::Language>,

    /// Print help
    #[arg(short, long, action = ArgAction::HelpShort, global = true, display_order = 901)]
    help: Option<bool>,

    /// Print the version
    #[arg(short = 'V', long, action = ArgAction::Version, display_order = 902)]
    version: Option<bool>,

    /// The command to run.
    #[command(subcommand)]
    pub(crate) command: CliCommand,
}

/// One variant per command; [`crate::commands::run`] has one line per variant.
#[derive(Debug, Subcommand)]
pub(crate) enum CliCommand {
    /// Write an ecosystem file for your own building: rooms, doors, devices and a goal
    #[command(after_help = edit::INIT_HELP)]
    Init(edit::InitArgs),
    /// Add a room, a door, an agent or a goal to an ecosystem file, and to the daemons that run it
    #[command(after_help = edit::ADD_HELP)]
    Add(edit::AddArgs),
    /// Run the daemon: open the substrate, host this machine's agents, join the ecosystem
    Up(UpArgs),
    /// Play a scenario of the paper against the simulated building, and check the outcome
    Scenario(ScenarioArgs),
    /// Plan a factored task with a daemon for each agent, which keeps its secrets
    Joint(joint::JointArgs),
    /// Open a prompt to a running ecosystem: goals, actions, answers, and their outcomes
    #[command(after_help = KEYBOARD_HELP)]
    Keyboard(KeyboardArgs),
    /// Ask a running ecosystem for a goal, and follow it to its end
    #[command(after_help = GOAL_HELP)]
    Goal(GoalArgs),
    /// Ask for one action, and follow it to its end
    #[command(after_help = ACT_HELP)]
    Act(ActArgs),
    /// Change the known facts
    #[command(after_help = SET_HELP)]
    Set(SetArgs),
    /// Change the planning mode of the running ecosystem
    Mode(ModeArgs),
    /// Answer a question that an agent asks a person; without arguments, list the open ones
    #[command(after_help = ANSWER_HELP)]
    Answer(AnswerArgs),
    /// Stop all actuators, or agents and places: they end what they do, and begin nothing
    #[command(after_help = stop::HELP)]
    Stop(stop::StopArgs),
    /// Show the agents that are present, and what they offer
    Agents(AgentsArgs),
    /// Show what all agents can do together, as a PDDL domain
    Domain(AskArgs),
    /// Show the known facts, the agent that states each, and until when it is believed
    State(AskArgs),
    /// Show the goals and the state of each; or one goal, with its history
    #[command(after_help = GOALS_HELP)]
    Goals(GoalsArgs),
    /// Look at a running ecosystem, or at a recording, in a screen of pages
    #[command(after_help = view::HELP)]
    View(view::ViewArgs),
    /// Show what happened, when something last worked, and values over time
    #[command(after_help = history::HISTORY_HELP)]
    History(history::HistoryArgs),
    /// Show why something is so or was done: from the thing up to a person, a sensor or a death
    #[command(after_help = history::WHY_HELP)]
    Why(history::WhyArgs),
    /// Show the messages of a running ecosystem as they are sent
    #[command(after_help = WATCH_HELP)]
    Watch(WatchArgs),
    /// Replay a recording in a new ecosystem, and compare the outcomes
    #[command(after_help = REPLAY_HELP)]
    Replay(ReplayArgs),
    /// Show how full agents' mailboxes are, and what has overflowed
    Mailbox(MailboxArgs),
    /// Find what is wrong with this machine or ecosystem, and the command that mends it
    #[command(after_help = doctor::HELP)]
    Doctor(doctor::DoctorArgs),
    /// Make, show and revoke keys and certificates of daemons
    #[command(after_help = cert::HELP)]
    Cert(cert::CertArgs),
    /// Add, change and remove people, their passwords, rights and tokens; show what they asked for
    #[command(after_help = people::HELP)]
    People(people::PeopleArgs),
    /// Show the sensors that this machine's kernel knows, and how to add them to an ecosystem
    #[command(after_help = SENSORS_HELP)]
    Sensors(SensorsArgs),
    /// Record the pose of a place, where a robot with ROS 2 stands now
    #[command(after_help = robot::HELP)]
    Robot(robot::RobotArgs),
    /// Add, list and remove plugins: programs that bring agents
    #[command(after_help = plugin::HELP)]
    Plugin(plugin::PluginArgs),
    /// Send one message as it is written, and print the answers
    #[command(after_help = SEND_HELP)]
    Send(SendArgs),
    /// Find a plan for a PDDL domain and problem
    #[command(after_help = althing_plan::arguments::help("althing plan"))]
    Plan(PlanArgs),
    /// Check a plan: print its cost, or the step and the condition that fail
    #[command(after_help = VALIDATE_HELP)]
    Validate(ValidateArgs),
    /// Find mistakes in ecosystem files, PDDL files and action models
    #[command(after_help = CHECK_HELP)]
    Check(CheckArgs),
    /// Print a script that makes a shell complete `althing` commands
    #[command(after_help = COMPLETIONS_HELP)]
    Completions(CompletionsArgs),
    /// Write all that must outlive this machine to one file
    #[command(after_help = backup::BACKUP_HELP)]
    Backup(backup::BackupArgs),
    /// Put in place what `althing backup` has written, on this machine or another
    #[command(after_help = backup::RESTORE_HELP)]
    Restore(backup::RestoreArgs),
}

const SENSORS_HELP: &str = "\
Reads Industrial I/O, hardware monitoring and 1-wire below /sys; needs no
special rights. A sensor that is not listed has no driver: `dtoverlay=...` on a
Raspberry Pi, `modprobe` and `new_device` elsewhere. Names and places stay the
same when the sensors are plugged in in another order.

  althing sensors --toml >> office.toml    then write the room of each sensor";

const VALIDATE_HELP: &str = "\
Exit codes: 0 the plan works, 1 it does not, 33 bad input, 34 unsupported

Example: althing validate domain.pddl problem.pddl plan.txt";

const CHECK_HELP: &str = "\
A problem and an action model are checked against the domain that they name: one
of the files given, or one found beside them. For an ecosystem file, every agent
is built as `up` builds it, and not started.

Exit codes: 0 no mistakes, 33 mistakes were found

Examples: althing check althing.toml
          althing check --print ontology althing.toml > domain.pddl
          althing check domains/*/*.pddl --json";

const KEYBOARD_HELP: &str = "\
At the prompt, Tab completes, `help` lists the verbs, Ctrl-D ends. A line that
begins with `(` is a goal. If standard input is not a terminal, its lines are
executed one after the other, and the exit code is 1 if one of them failed.

Examples: althing keyboard
          echo \"act (move turtlebot-1 corridor office1)\" | althing keyboard";

const GOAL_HELP: &str = "\
A goal by the clock is kept by the Journals, and asked for once by the leader
then. A machine that was away asks up to 15 minutes late. `althing goals` shows
what is due, --cancel with its id ends it.

Examples: althing goal temperatures
          althing goal temperatures --every \"day 08:00\" --on workdays --by 08:30
          althing goal temperatures --maintain --between 08:00-18:00
          althing goal \"(known-temperature office1)\" --at 2026-12-01T08:00";

const ACT_HELP: &str = "\
The first argument of an action is the agent that acts. Ctrl-C cancels it.

Example: althing act \"(move turtlebot-1 corridor office1)\"";

const SET_HELP: &str = "\
Facts that an agent states itself override the change with its next heartbeat.

Examples: althing set \"(known-temperature office1)\"
          althing set \"(= (distance corridor office1) 9)\"
          althing set --retract \"(connected corridor office1)\"";

const ANSWER_HELP: &str = "\
Examples: althing answer               lists the open questions
          althing answer 1 yes         if only one keyboard has a question 1
          althing answer hall/1 yes    question 1 of the keyboard `hall`
          althing answer 1             prompts for the answer, hides a secret
          althing answer 1 < pin       takes the first line of a file";

const WATCH_HELP: &str = "\
Examples: althing watch
          althing watch --conversation 3      goal 3, as a sequence diagram
          althing watch --record day.jsonl    for `althing replay`";

const REPLAY_HELP: &str = "\
The requests from outside (goals, actions, changes) are sent again, each at its
time, to agents that are started in memory, with a new simulated building. The
outcome of each request is compared with the recorded one.

--lose and --duplicate apply to the messages of all agents, not only to the
requests; messages whose delivery is guaranteed are sent again. The same seed
loses the same messages of each sender; time is real, so their contents may
differ. An action that is requested because of outdated facts may be refused
although it was accepted in the recording.

Exit codes: 0 all outcomes as recorded, 1 some differ, 33 not a recording, 78 no
ecosystem

Example: althing replay day.jsonl --ecosystem office.toml --speed 10 --lose 0.1";

const SEND_HELP: &str = "\
The message is an object with `receiver` (a name; to all without it),
`performative` (request, query-ref, cfp or cancel) and `content`; where they are
not given, `protocol`, `conversation_id` and `reply_within` (milliseconds) are
chosen. Sender, ids and version are the keyboard's.

Example: {\"receiver\": \"keyboard\", \"performative\": \"query-ref\",
          \"content\": {\"text\": \"May I enter?\"}, \"reply_within\": 30000}";

const GOALS_HELP: &str = "\
Each goal has a number, the same on every machine. Commands take it: `althing
goal --cancel 3`, `althing why 3`, `althing watch --conversation 3`.

Examples: althing goals                all goals, one line or two for each
          althing goals 3              goal 3, and what has happened to it";

const COMPLETIONS_HELP: &str = "\
The words of goals are completed, too, within quotes.

Examples: source <(althing completions bash)          in ~/.bashrc
          source <(althing completions zsh)           in ~/.zshrc
          althing completions fish | source           in config.fish";

/// Arguments of `althing up`.
#[derive(Debug, Args)]
pub(crate) struct UpArgs {
    /// The ecosystem file [default: ./althing.toml, then the configuration folders]
    #[arg(value_name = "ECOSYSTEM.toml")]
    pub(crate) file: Option<PathBuf>,
    /// The daemon of the file that this machine runs [default: the host name]
    #[arg(long, value_name = "NAME")]
    pub(crate) daemon: Option<String>,
    /// A goal to pursue from the start: in words, in PDDL, or a name from the file; may be repeated
    #[arg(long = "goal", value_name = "GOAL")]
    pub(crate) goals: Vec<String>,
    /// The planning mode, in place of the one in the file
    #[arg(long)]
    pub(crate) mode: Option<ModeArg>,
    /// The endpoint of another daemon, such as tls/office-pi.local:7447; may be repeated
    #[arg(long, value_name = "ENDPOINT")]
    pub(crate) connect: Vec<String>,
    /// Open a prompt on this terminal; Ctrl-D there ends the daemon too
    #[arg(long)]
    pub(crate) keyboard: bool,
    /// Stop when standard input ends, as it does when the program that started this one ends
    #[arg(long, conflicts_with = "keyboard")]
    pub(crate) until_stdin_ends: bool,
}

/// Arguments of `althing keyboard`.
#[derive(Debug, Args)]
pub(crate) struct KeyboardArgs {
    /// The name of this keyboard, for the agents that ask its user [default: a new name]
    #[arg(long, value_name = "NAME")]
    pub(crate) name: Option<String>,
    #[command(flatten)]
    pub(crate) reach: ReachArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing scenario`.
#[derive(Debug, Args)]
pub(crate) struct ScenarioArgs {
    /// The scenario of the paper; 4 is its Figure 1, 5 to 8 need several agents at a time
    #[arg(value_name = "N", value_parser = clap::value_parser!(u8).range(1..=8))]
    pub(crate) number: u8,
    /// The planning mode [default: decentralized]
    #[arg(long)]
    pub(crate) mode: Option<ModeArg>,
    /// Spread the agents over several `althing up` processes
    #[arg(long)]
    pub(crate) processes: bool,
    /// The transport of messages between the agents of one process
    #[arg(long, value_enum, default_value_t = SubstrateArg::Zenoh, conflicts_with = "processes")]
    pub(crate) substrate: SubstrateArg,
    /// Generate another building: rooms, doors, distances, the sensor that dies
    #[arg(long, value_name = "N")]
    pub(crate) seed: Option<u64>,
    /// Write the messages of the scenario to this file, for `althing view --recording`
    #[arg(long, value_name = "FILE")]
    pub(crate) record: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing goal`.
#[derive(Debug, Args)]
pub(crate) struct GoalArgs {
    #[command(flatten)]
    pub(crate) wish: WishArgs,
    #[command(flatten)]
    pub(crate) reach: ReachArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments that describe a goal, on the command line and at the prompt.
#[derive(Debug, Args)]
#[command(group = ArgGroup::new("what").required(true).args(["goal", "cancel"]))]
pub(crate) struct WishArgs {
    /// The goal in words, such as "temperature of office1 known", or in PDDL, or a name from the
    /// ecosystem file
    pub(crate) goal: Option<String>,
    /// Keep the goal: plan again whenever it no longer holds
    #[arg(long, conflicts_with = "cancel")]
    pub(crate) maintain: bool,
    /// The priority; greater goes first [default: that of the goal in the file, or 0]
    #[arg(long, value_name = "N", allow_negative_numbers = true, conflicts_with = "cancel", value_parser = priority)]
    pub(crate) priority: Option<i32>,
    /// What happens to the goal during a network partition [default: that of the goal in the file,
    /// or pursue]
    #[arg(long, value_enum, conflicts_with = "cancel")]
    pub(crate) partition: Option<PartitionArg>,
    /// Plan only, and ask for nothing: print the plan, its cost and what it undoes, or why there is
    /// no plan
    #[arg(long, conflicts_with = "cancel")]
    pub(crate) dry_run: bool,
    /// Cancel the goal with this number in `althing goals`, or of this conversation
    #[arg(long, value_name = "N|ID")]
    pub(crate) cancel: Option<String>,
    #[command(flatten)]
    pub(crate) times: times::TimeArgs,
}

/// Arguments of `althing act`.
#[derive(Debug, Args)]
pub(crate) struct ActArgs {
    #[command(flatten)]
    pub(crate) action: ActionArgs,
    #[command(flatten)]
    pub(crate) reach: ReachArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Argument that gives one action, on the command line and at the prompt.
#[derive(Debug, Args)]
pub(crate) struct ActionArgs {
    /// A ground action, such as "(move turtlebot-1 corridor office1)"
    pub(crate) action: String,
}

/// Arguments of `althing set`.
#[derive(Debug, Args)]
pub(crate) struct SetArgs {
    #[command(flatten)]
    pub(crate) facts: FactArgs,
    #[command(flatten)]
    pub(crate) reach: ReachArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments that give facts, on the command line and at the prompt.
#[derive(Debug, Args)]
pub(crate) struct FactArgs {
    /// Facts, such as "(door-open d1)" or "distance from corridor to office1 is 9 m"
    #[arg(required = true, value_name = "FACT")]
    pub(crate) facts: Vec<String>,
    /// The facts are no longer true
    #[arg(long)]
    pub(crate) retract: bool,
}

/// Arguments of `althing mode`.
#[derive(Debug, Args)]
pub(crate) struct ModeArgs {
    /// The planning mode from now on
    pub(crate) mode: ModeArg,
    #[command(flatten)]
    pub(crate) reach: ReachArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing answer`.
#[derive(Debug, Args)]
pub(crate) struct AnswerArgs {
    #[command(flatten)]
    pub(crate) reply: ReplyArgs,
    #[command(flatten)]
    pub(crate) reach: ReachArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments that answer a question, on the command line and at the prompt.
#[derive(Debug, Args)]
pub(crate) struct ReplyArgs {
    /// The question: its number, or KEYBOARD/NUMBER
    pub(crate) id: Option<String>,
    /// The answer; if left out, it is prompted for, or read from standard input, as fits a secret
    pub(crate) text: Vec<String>,
}

/// Arguments of `althing mailbox`.
#[derive(Debug, Args)]
pub(crate) struct MailboxArgs {
    #[command(flatten)]
    pub(crate) whose: WhoseArgs,
    #[command(flatten)]
    pub(crate) reach: ReachArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Argument that names the agent of a mailbox, on the command line and at the prompt.
#[derive(Debug, Args)]
pub(crate) struct WhoseArgs {
    /// The agent [default: all agents]
    #[arg(value_name = "AGENT")]
    pub(crate) agent: Option<String>,
}

/// Arguments of `althing send`.
#[derive(Debug, Args)]
pub(crate) struct SendArgs {
    /// A file with the message, or - for standard input
    #[arg(value_name = "FILE|-")]
    pub(crate) file: PathBuf,
    #[command(flatten)]
    pub(crate) reach: ReachArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing completions`.
#[derive(Debug, Args)]
pub(crate) struct CompletionsArgs {
    /// The shell
    #[arg(required_unless_present = "words")]
    pub(crate) shell: Option<ShellArg>,
    /// Print the goals in words that this text can become by one more word; scripts call this
    #[arg(long, value_name = "TEXT", conflicts_with = "shell", hide = true)]
    pub(crate) words: Option<String>,
}

/// Arguments of `althing sensors`.
#[derive(Debug, Args)]
pub(crate) struct SensorsArgs {
    /// Print lines for an ecosystem file instead: an agent for each sensor
    #[arg(long, conflicts_with = "json")]
    pub(crate) toml: bool,
    /// The folder where the kernel shows its devices
    #[arg(long, value_name = "FOLDER", default_value = "/sys")]
    pub(crate) sysfs: PathBuf,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of the commands that only show something, such as `althing domain`.
#[derive(Debug, Args)]
pub(crate) struct AskArgs {
    #[command(flatten)]
    pub(crate) reach: ReachArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing goals`.
#[derive(Debug, Args)]
pub(crate) struct GoalsArgs {
    /// Show this goal alone, with its history: its number, or its conversation
    #[arg(value_name = "N")]
    pub(crate) goal: Option<String>,
    #[command(flatten)]
    pub(crate) ask: AskArgs,
}

/// Arguments of `althing agents`.
#[derive(Debug, Args)]
pub(crate) struct AgentsArgs {
    /// Show instead the discovered agents, which no file names, and the lines that name them
    #[arg(long)]
    pub(crate) discovered: bool,
    #[command(flatten)]
    pub(crate) ask: AskArgs,
}

/// Arguments of `althing watch`.
#[derive(Debug, Args)]
pub(crate) struct WatchArgs {
    /// Only the messages of the goal with this number in `althing goals`, or of this conversation,
    /// as a sequence diagram
    #[arg(long, value_name = "N|ID")]
    pub(crate) conversation: Option<String>,
    /// Write the messages to this file instead, for `althing replay`
    #[arg(long, value_name = "FILE", conflicts_with = "json")]
    pub(crate) record: Option<PathBuf>,
    /// How large the file may become
    #[arg(long, value_name = "MIB", default_value_t = 256, requires = "record")]
    pub(crate) record_max: u64,
    #[command(flatten)]
    pub(crate) reach: ReachArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing replay`.
#[derive(Debug, Args)]
pub(crate) struct ReplayArgs {
    /// The recording that `althing watch --record` has written
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// The ecosystem to replay it in; its agents are started in memory
    #[arg(long, value_name = "FILE|NAME")]
    pub(crate) ecosystem: Option<String>,
    /// How many times faster than recorded, the simulated building included
    #[arg(long, value_name = "TIMES", default_value_t = 1.0, value_parser = speed)]
    pub(crate) speed: f64,
    /// The share of the messages that is lost, from 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = share)]
    pub(crate) lose: f64,
    /// The share of the messages that arrives twice, from 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = share)]
    pub(crate) duplicate: f64,
    /// The seed that chooses the lost and doubled messages
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) seed: u64,
    /// How long to wait for an outcome beyond its recorded time, in seconds
    #[arg(long, value_name = "S", default_value_t = 60)]
    pub(crate) patience: u32,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

fn share(text: &str) -> Result<f64, String> {
    let share = text.parse::<f64>().ok().filter(|share| (0.0..=1.0).contains(share));
    share.ok_or_else(|| "a share is a number from 0 to 1, such as 0.1".to_owned())
}

/// Parses the priority of a goal.
fn priority(text: &str) -> Result<i32, String> {
    text.parse()
        .map_err(|_| "a priority is a whole number; greater goes first, such as 5".to_owned())
}

fn speed(text: &str) -> Result<f64, String> {
    let speed = text.parse::<f64>().ok().filter(|speed| (0.01..=1_000.0).contains(speed));
    speed.ok_or_else(|| "a speed is a number from 0.01 to 1000, such as 10".to_owned())
}

/// Arguments of `watch` at the prompt.
#[derive(Debug, Args)]
pub(crate) struct WatchWords {
    /// Only the messages of one goal: its number here, # and its number in `goals`, or its
    /// conversation
    #[arg(conflicts_with = "conversation")]
    pub(crate) id: Option<String>,
    /// The same, as on the command line
    #[arg(long, value_name = "ID")]
    pub(crate) conversation: Option<String>,
    /// Stop watching
    #[arg(long)]
    pub(crate) off: bool,
}

/// Arguments of `althing validate`.
#[derive(Debug, Args)]
pub(crate) struct ValidateArgs {
    /// The PDDL domain
    #[arg(value_name = "DOMAIN")]
    pub(crate) domain: PathBuf,
    /// The PDDL problem
    #[arg(value_name = "PROBLEM")]
    pub(crate) problem: PathBuf,
    /// The plan, in the format of the planning competitions
    #[arg(value_name = "PLAN")]
    pub(crate) plan: PathBuf,
    /// Stop after this many seconds, reading included
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub(crate) time_limit: Option<Duration>,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing check`.
#[derive(Debug, Args)]
pub(crate) struct CheckArgs {
    /// Ecosystem files (.toml), PDDL domains, problems and action models [default: ./althing.toml,
    /// then the configuration folders]
    #[arg(value_name = "FILE")]
    pub(crate) files: Vec<PathBuf>,
    /// Read every .pddl file below this folder; count the results, and list what is refused, with
    /// the reasons
    #[arg(long, value_name = "FOLDER", conflicts_with = "files")]
    pub(crate) tree: Option<PathBuf>,
    /// Print the ontology or the map of an ecosystem file as PDDL, also if it has tables in their
    /// place; mistakes go to standard error
    #[arg(long = "print", value_name = "PART", conflicts_with_all = ["tree", "json"])]
    pub(crate) printed: Option<PddlPart>,
    /// With --tree, list the warnings for the files that are read, too
    #[arg(long, requires = "tree")]
    pub(crate) warnings: bool,
    /// Stop after this many seconds, reading included
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub(crate) time_limit: Option<Duration>,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Part of an ecosystem file that `althing check --print` prints.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum PddlPart {
    /// The places, and the ways between them
    Map,
    /// The types, predicates and functions that all agents share
    Ontology,
}

/// Arguments by which a command finds a running ecosystem.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct ReachArgs {
    /// The ecosystem: its file, or its name in the configuration folders
    #[arg(long, value_name = "FILE|NAME")]
    pub(crate) ecosystem: Option<String>,
    /// The endpoint of one of its daemons, such as tls/office-pi.local:7447; may be repeated
    #[arg(long, value_name = "ENDPOINT")]
    pub(crate) connect: Vec<String>,
    /// The name of the key to use in a secured ecosystem [default: this machine's daemon]
    #[arg(long = "as", value_name = "NAME")]
    pub(crate) key: Option<String>,
}

/// Shell for which `althing completions` prints a script.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ShellArg {
    /// The Bourne Again Shell
    Bash,
    /// Z shell
    Zsh,
    /// The friendly interactive shell
    Fish,
}

/// Transport of the messages of a scenario.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum SubstrateArg {
    /// Zenoh
    Zenoh,
    /// The memory of this process, without a network
    Memory,
}

/// The planning mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ModeArg {
    /// One planning agent plans for all
    Centralized,
    /// Every actuator plans for itself, and the best proposals win
    Decentralized,
}

/// Behaviour of a goal during a network partition.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum PartitionArg {
    /// Every part of the ecosystem pursues the goal with the agents that it reaches
    Pursue,
    /// Only the part that reaches a quorum of the Journals plans for the goal
    Wait,
}

impl From<PartitionArg> for acl::content::Partition {
    fn from(partition: PartitionArg) -> acl::content::Partition {
        match partition {
            PartitionArg::Pursue => acl::content::Partition::Pursue,
            PartitionArg::Wait => acl::content::Partition::Wait,
        }
    }
}

// === impl ModeArg ===

impl From<ModeArg> for agent::Mode {
    fn from(mode: ModeArg) -> agent::Mode {
        match mode {
            ModeArg::Centralized => agent::Mode::Centralized,
            ModeArg::Decentralized => agent::Mode::Decentralized,
        }
    }
}

/// Whether a command of this name exists.
pub(crate) fn has_command(name: &str) -> bool {
    Cli::command().find_subcommand(name).is_some()
}

/// Parses the tag of a language.
fn language(tag: &str) -> Result<phrases::Language, String> {
    phrases::Language::from_tag(tag).ok_or_else(|| {
        let known: Vec<_> = phrases::Language::ALL.iter().map(|known| known.tag()).collect();
        format!("there are words in {}", known.join(" and "))
    })
}

/// Parses the command line. After printing help, the version or a mistake in the arguments, returns
/// the exit code as the error.
pub(crate) fn parse() -> Result<Cli, ExitCode> {
    let words: Vec<_> = std::env::args_os().collect();
    let asks_for_help =
        |word: &std::ffi::OsString| ["-h", "--help", "help"].iter().any(|help| word == help);
    if let [_, only] = words.as_slice()
        && asks_for_help(only)
    {
        return Err(terminal::output::print(help::text(), exit::DONE));
    }
    terminal::arguments::parse(words)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    /// Checks that the texts below the options in the help fit into 80 columns. The lines of these
    /// texts are broken by hand, and a longer line would be broken a second time.
    #[test]
    fn help_below_the_options_fits_a_terminal() {
        fn all(command: &clap::Command, seen: &mut Vec<String>) {
            seen.extend(command.get_after_help().map(ToString::to_string));
            command.get_subcommands().for_each(|below| all(below, seen));
        }
        let mut seen = Vec::new();
        all(&Cli::command(), &mut seen);
        assert!(seen.len() > 10, "{seen:?}");
        for line in seen.iter().flat_map(|help| help.lines()) {
            assert!(line.chars().count() <= 80, "{line}");
        }
    }
}
