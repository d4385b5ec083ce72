//! Arguments of `althing init` and `althing add`, which write and change ecosystem files.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use ecosystem_edit::{
    DoorWords, GoalWords, PlaceOptions, RobotWords, SensorWords, SettingText, meters,
};
use terminal::arguments::PrintArgs;

pub(crate) const INIT_HELP: &str = "\
At a terminal, questions are asked for what the options do not say, and devices
near this machine are offered. Nothing is overwritten.

  --room NAME[:KIND]            kitchen, hall:corridor
  --door ROOM=ROOM[:METERS]     hall=kitchen:4
  --sensor QUANTITY@ROOM[=DEV]  temperature@kitchen; DEV of `althing sensors`
  --sensor temperature@ROBOT    a thermometer that the robot carries
  --robot KIND@ROOM             turtlebot@hall
  --goal NAME=GOAL              warm=\"(known-temperature kitchen)\"

Examples: althing init
          althing init --name home --room hall:corridor --room kitchen \\
            --door hall=kitchen:4 --sensor temperature@kitchen --simulated --yes";

pub(crate) const ADD_HELP: &str = "\
The difference is shown first, and the file is written when you agree (--yes
agrees beforehand). Comments and order stay as they are. The new text is checked
as `althing check` does; one with mistakes is not written. Then the daemons on
this machine that run the file read it again.

Examples: althing add room attic --floor 2 --door hall=6.5
          althing add door attic kitchen --length 3
          althing add agent co2-attic --plugin sensor --location attic \\
            --set quantity=co2 --driver simulated
          althing add goal air \"(known-co2 attic)\" --keep";

/// Arguments of `althing init`.
#[derive(Debug, Args)]
pub(crate) struct InitArgs {
    /// The file to write [default: ./althing.toml]
    #[arg(value_name = "FILE.toml")]
    pub(crate) file: Option<PathBuf>,
    /// The name of the ecosystem [default: that of the folder]
    #[arg(long, value_name = "NAME")]
    pub(crate) name: Option<String>,
    /// A place; may be repeated
    #[arg(long = "room", value_name = "NAME[:KIND]")]
    pub(crate) rooms: Vec<PlaceOptions>,
    /// A door, which leads both ways; may be repeated
    #[arg(long = "door", value_name = "ROOM=ROOM[:METERS]")]
    pub(crate) doors: Vec<DoorWords>,
    /// A sensor; may be repeated
    #[arg(long = "sensor", value_name = "QUANTITY@ROOM[=DEVICE]")]
    pub(crate) sensors: Vec<SensorWords>,
    /// A robot; may be repeated
    #[arg(long = "robot", value_name = "KIND@ROOM")]
    pub(crate) robots: Vec<RobotWords>,
    /// A goal that is kept; may be repeated
    #[arg(long = "goal", value_name = "NAME=GOAL")]
    pub(crate) goals: Vec<GoalWords>,
    /// Robots, and sensors without a device, act in a simulated building
    #[arg(long)]
    pub(crate) simulated: bool,
    /// Look for devices near this machine also without questions, and write them as comments
    #[arg(long, conflicts_with = "no_discovery")]
    pub(crate) discover: bool,
    /// Do not look for devices near this machine
    #[arg(long)]
    pub(crate) no_discovery: bool,
    /// Ask nothing, and write the file
    #[arg(short, long)]
    pub(crate) yes: bool,
    /// The folder where the kernel shows its devices
    #[arg(long, value_name = "FOLDER", default_value = "/sys", hide = true)]
    pub(crate) sysfs: PathBuf,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing add`.
#[derive(Debug, Args)]
pub(crate) struct AddArgs {
    /// The thing to add.
    #[command(subcommand)]
    pub(crate) command: AddCommand,
}

/// Subcommands of `althing add`.
#[derive(Debug, Subcommand)]
pub(crate) enum AddCommand {
    /// Add a room, or another place
    Room(AddRoomArgs),
    /// Add a door between two places
    Door(AddDoorArgs),
    /// Add an agent
    Agent(AddAgentArgs),
    /// Add a goal with a name
    Goal(AddGoalArgs),
}

/// Arguments of `althing add room`.
#[derive(Debug, Args)]
pub(crate) struct AddRoomArgs {
    /// The name of the place
    pub(crate) name: String,
    /// Its type in the ontology, such as corridor [default: room]
    #[arg(long, value_name = "TYPE")]
    pub(crate) kind: Option<String>,
    /// The number of its floor, or its name
    #[arg(long, value_name = "FLOOR", allow_negative_numbers = true)]
    pub(crate) floor: Option<String>,
    /// Its area in square meters
    #[arg(long, value_name = "M2")]
    pub(crate) area: Option<f64>,
    /// A door to another place, and its length in meters; may be repeated
    #[arg(long = "door", value_name = "ROOM[=METERS]", value_parser = side)]
    pub(crate) doors: Vec<DoorSide>,
    /// A further key of the place; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = SettingText::read)]
    pub(crate) settings: Vec<SettingText>,
    #[command(flatten)]
    pub(crate) edit: EditArgs,
}

/// Arguments of `althing add door`.
#[derive(Debug, Args)]
pub(crate) struct AddDoorArgs {
    /// The place on one side
    pub(crate) from: String,
    /// The place on the other side
    pub(crate) to: String,
    /// The length of the way in meters
    #[arg(long, value_name = "METERS", value_parser = length)]
    pub(crate) length: Option<f64>,
    /// The door leads from the first place to the second only
    #[arg(long)]
    pub(crate) one_way: bool,
    #[command(flatten)]
    pub(crate) edit: EditArgs,
}

/// Arguments of `althing add agent`.
#[derive(Debug, Args)]
pub(crate) struct AddAgentArgs {
    /// The name of the agent
    pub(crate) name: String,
    /// Its kind, such as temperature-sensor
    #[arg(long, value_name = "PLUGIN")]
    pub(crate) plugin: String,
    /// What it acts through, such as simulated [default: the first driver of the plugin]
    #[arg(long, value_name = "DRIVER")]
    pub(crate) driver: Option<String>,
    /// The place where it stands, or where a robot starts
    #[arg(long, value_name = "ROOM")]
    pub(crate) location: Option<String>,
    /// The daemon that hosts it; may be repeated for standbys [default: this machine's]
    #[arg(long = "daemon", value_name = "NAME")]
    pub(crate) daemons: Vec<String>,
    /// A key of its config, such as quantity=co2; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = SettingText::read)]
    pub(crate) settings: Vec<SettingText>,
    #[command(flatten)]
    pub(crate) edit: EditArgs,
}

/// Arguments of `althing add goal`.
#[derive(Debug, Args)]
pub(crate) struct AddGoalArgs {
    /// The name of the goal
    pub(crate) name: String,
    /// The goal, such as "(known-temperature kitchen)"
    pub(crate) goal: String,
    /// Keep the goal from now on, without a person that asks for it
    #[arg(long)]
    pub(crate) keep: bool,
    /// A further key of the goal, such as priority=2; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = SettingText::read)]
    pub(crate) settings: Vec<SettingText>,
    #[command(flatten)]
    pub(crate) edit: EditArgs,
}

/// Arguments that all commands have that change an ecosystem file.
#[derive(Debug, Args)]
pub(crate) struct EditArgs {
    /// The ecosystem: its file, or its name in the configuration folders
    #[arg(long, value_name = "FILE|NAME")]
    pub(crate) ecosystem: Option<String>,
    /// Agree to the difference beforehand
    #[arg(short, long)]
    pub(crate) yes: bool,
    /// Show the difference, and change nothing
    #[arg(long, conflicts_with = "yes")]
    pub(crate) dry_run: bool,
    /// Change the file only; daemons take it when they read it again
    #[arg(long)]
    pub(crate) file_only: bool,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// The other side of a door.
#[derive(Clone, Debug)]
pub(crate) struct DoorSide {
    pub(crate) room: String,
    pub(crate) length: Option<f64>,
}

/// Parses a length in meters.
fn length(text: &str) -> Result<f64, String> {
    meters(text).ok_or_else(|| "a length is a number of meters above 0, such as 3.5".to_owned())
}

fn side(text: &str) -> Result<DoorSide, String> {
    let (room, length) = match text.split_once('=') {
        None => (text, None),
        Some((room, length)) => {
            let read = length.trim().parse::<f64>();
            let read = read.map_err(|_| "write ROOM=METERS, such as hall=6.5".to_owned())?;
            (room, Some(read))
        }
    };
    Ok(DoorSide { room: room.trim().to_owned(), length })
}
