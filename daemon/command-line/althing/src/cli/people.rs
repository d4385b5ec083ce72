//! The arguments of `althing people`.

use accounts::{PersonRight, PersonRole};
use clap::builder::{PossibleValuesParser, TypedValueParser as _};
use clap::{ArgGroup, Args, Subcommand};
use terminal::arguments::PrintArgs;

pub(super) const HELP: &str = "\
People are kept in people.toml beside the ecosystem file, with hashes in place
of passwords. Whoever may write that file makes the first person; copy the file
to each machine that serves a page. Running daemons read it within seconds, and
a person that is removed is signed out at once.

Roles: visitor    look, ask
       caretaker  look, ask, admit, stop
       operator   look, ask, change, admit, stop

Examples: althing people add anna --role caretaker
          althing people add dashboard --rights look --no-password
          althing people token add dashboard wall-display
          althing people add-screen turtlebot-1
          althing people remove anna
          althing people log anna";

/// Arguments of `althing people`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub(crate) struct PeopleArgs {
    /// The command to run; without one, people are listed.
    #[command(subcommand)]
    pub(crate) command: Option<PeopleCommand>,
    #[command(flatten)]
    pub(crate) list: PeopleListArgs,
}

/// Subcommands of `althing people`.
#[derive(Debug, Subcommand)]
pub(crate) enum PeopleCommand {
    /// List the people, their rights and their tokens
    List(PeopleListArgs),
    /// Add a person
    Add(PeopleAddArgs),
    /// Add the screen on board of a robot, and print its link once
    AddScreen(PeopleScreenArgs),
    /// Remove a person or a screen, who is signed out at once
    Remove(PeopleRemoveArgs),
    /// Set a new password; sessions with the old one end at once
    Password(PeoplePasswordArgs),
    /// Set the rights of a person, in place of those before
    Rights(PeopleRightsArgs),
    /// Add and remove tokens, with which programs act for a person
    Token(PeopleTokenArgs),
    /// Show what people asked this machine's daemons for, and from where
    Log(PeopleLogArgs),
}

/// Arguments of `althing people list`.
#[derive(Debug, Args)]
pub(crate) struct PeopleListArgs {
    #[command(flatten)]
    pub(crate) place: PeoplePlaceArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing people add`.
#[derive(Debug, Args)]
pub(crate) struct PeopleAddArgs {
    /// The name of the person: 1 to 32 of a-z, 0-9, - and _
    #[arg(value_name = "NAME")]
    pub(crate) name: String,
    #[command(flatten)]
    pub(crate) granted: GrantedRightsArgs,
    #[command(flatten)]
    pub(crate) password: NewPasswordArgs,
    /// Give no password: only programs act for this person, with tokens
    #[arg(long, conflicts_with = "generate")]
    pub(crate) no_password: bool,
    #[command(flatten)]
    pub(crate) place: PeoplePlaceArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing people add-screen`.
#[derive(Debug, Args)]
pub(crate) struct PeopleScreenArgs {
    /// The robot whose page the screen shows: it sees this robot, answers its questions and stops it
    #[arg(value_name = "ROBOT")]
    pub(crate) robot: String,
    /// The name of the screen, by which it is removed [default: ROBOT-screen]
    #[arg(long, value_name = "NAME")]
    pub(crate) name: Option<String>,
    #[command(flatten)]
    pub(crate) place: PeoplePlaceArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing people remove`.
#[derive(Debug, Args)]
pub(crate) struct PeopleRemoveArgs {
    /// The person to remove
    #[arg(value_name = "NAME")]
    pub(crate) name: String,
    #[command(flatten)]
    pub(crate) place: PeoplePlaceArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing people password`.
#[derive(Debug, Args)]
pub(crate) struct PeoplePasswordArgs {
    /// The person that gets a new password
    #[arg(value_name = "NAME")]
    pub(crate) name: String,
    #[command(flatten)]
    pub(crate) password: NewPasswordArgs,
    #[command(flatten)]
    pub(crate) place: PeoplePlaceArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing people rights`.
#[derive(Debug, Args)]
#[command(group = ArgGroup::new("granted").required(true).args(["rights", "role"]))]
pub(crate) struct PeopleRightsArgs {
    /// The person that gets other rights
    #[arg(value_name = "NAME")]
    pub(crate) name: String,
    #[command(flatten)]
    pub(crate) granted: GrantedRightsArgs,
    #[command(flatten)]
    pub(crate) place: PeoplePlaceArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing people token`.
#[derive(Debug, Args)]
pub(crate) struct PeopleTokenArgs {
    /// The command to run.
    #[command(subcommand)]
    pub(crate) command: PeopleTokenCommand,
}

/// Subcommands of `althing people token`.
#[derive(Debug, Subcommand)]
pub(crate) enum PeopleTokenCommand {
    /// Make a token, and print it once
    Add(PeopleTokenNameArgs),
    /// Remove a token; programs that have it are refused at once
    Remove(PeopleTokenNameArgs),
}

/// Arguments of `althing people token add` and `althing people token remove`.
#[derive(Debug, Args)]
pub(crate) struct PeopleTokenNameArgs {
    /// The person for which the program acts, with this person's rights
    #[arg(value_name = "NAME")]
    pub(crate) name: String,
    /// The name of the token
    #[arg(value_name = "TOKEN")]
    pub(crate) token: String,
    #[command(flatten)]
    pub(crate) place: PeoplePlaceArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing people log`.
#[derive(Debug, Args)]
pub(crate) struct PeopleLogArgs {
    /// The person whose requests are shown [default: all]
    #[arg(value_name = "NAME")]
    pub(crate) name: Option<String>,
    /// How many requests are shown, the newest ones
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = at_least_one)]
    pub(crate) last: usize,
    #[command(flatten)]
    pub(crate) place: PeoplePlaceArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments that give rights.
#[derive(Debug, Args)]
pub(crate) struct GrantedRightsArgs {
    /// Rights, with commas: look, ask, change, admit, stop, secrets
    #[arg(long, value_name = "RIGHTS", value_delimiter = ',', conflicts_with = "role", value_parser = right())]
    pub(crate) rights: Vec<PersonRight>,
    /// A role, in place of single rights [default: visitor]
    #[arg(long, value_name = "ROLE", value_parser = role())]
    pub(crate) role: Option<PersonRole>,
}

/// Arguments that say where a new password comes from. Without them it is asked for, or read from
/// standard input.
#[derive(Debug, Args)]
pub(crate) struct NewPasswordArgs {
    /// Make a password, and print it once
    #[arg(long)]
    pub(crate) generate: bool,
}

/// Arguments that name the ecosystem.
#[derive(Debug, Args)]
pub(crate) struct PeoplePlaceArgs {
    /// The ecosystem: its file, or its name [default: ./althing.toml]
    #[arg(long, value_name = "FILE|NAME")]
    pub(crate) ecosystem: Option<String>,
}

fn right() -> impl clap::builder::TypedValueParser<Value = PersonRight> {
    let words = PossibleValuesParser::new(PersonRight::ALL.map(PersonRight::as_str));
    words.try_map(|word| PersonRight::parse(&word).ok_or("no such right"))
}

fn role() -> impl clap::builder::TypedValueParser<Value = PersonRole> {
    let words = PossibleValuesParser::new(PersonRole::ALL.map(PersonRole::as_str));
    words.try_map(|word| {
        let role = PersonRole::ALL.into_iter().find(|role| role.as_str() == word);
        role.ok_or("no such role")
    })
}

/// Parses a number of at least one.
fn at_least_one(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(0) | Err(_) => Err("write a number of at least 1".to_owned()),
        Ok(number) => Ok(number),
    }
}
