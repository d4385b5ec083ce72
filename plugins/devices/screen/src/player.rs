//! The trait of the programs and devices that drive a screen, and how such a program is started.

use std::path::Path;
use std::time::Duration;

use programs::{Program, ProgramStart, RunningProgram, is_installed};
use screen_link::ScreenLinkError;
use tokio::net::UnixStream;

use crate::content::{Content, PlayerSettings};

/// Time for a program to end after its connection is lost, so that the program's own reason can be
/// reported.
const ENDING: Duration = Duration::from_secs(1);

/// Environment variables; a program needs one of them to find a screen.
const DISPLAYS: &[&str] = &["DISPLAY", "WAYLAND_DISPLAY"];

/// A running program that shows media, or a connection to a device that does. Error texts complete
/// “failed to …”.
pub(crate) trait Player: Send + Sized + 'static {
    /// What the config says about the program or the device.
    type Settings: Clone + Send + Sync + 'static;

    /// Starts the program, with a dark screen; or connects to the device, and leaves it as it is.
    fn start(settings: &Self::Settings) -> impl Future<Output = Result<Self, String>> + Send;

    /// Shows this medium, and returns when it can be seen; `None` turns the screen dark.
    fn show(
        &mut self,
        content: Option<&Content>,
    ) -> impl Future<Output = Result<(), PlayerTrouble>> + Send;

    /// Checks whether the program shows the medium that was requested last.
    fn check(&mut self) -> impl Future<Output = Result<(), PlayerTrouble>> + Send;

    /// Waits until the program ends or can show nothing any more, and returns the reason. No event
    /// is lost if the future is dropped.
    fn failed(&mut self) -> impl Future<Output = String> + Send;

    /// Ends the program, and waits until nothing is left of it.
    fn end(self) -> impl Future<Output = ()> + Send;
}

/// Reason why a program does not show the medium that was requested.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum PlayerTrouble {
    /// The medium cannot be shown; the program works.
    Content(String),
    /// The program has to be started again.
    Program(String),
}

impl From<ScreenLinkError> for PlayerTrouble {
    fn from(error: ScreenLinkError) -> PlayerTrouble {
        match error.is_of_command() {
            true => PlayerTrouble::Content(error.to_string()),
            false => PlayerTrouble::Program(error.to_string()),
        }
    }
}

/// Returns the program of the settings; if they name none, the first of `known` that is in a folder
/// of `PATH`.
pub(crate) fn find_program(settings: &PlayerSettings, known: &[&str]) -> Result<String, String> {
    match &settings.program {
        Some(program) if is_installed(program) => Ok(program.clone()),
        Some(program) => Err(format!("find the program `{program}`")),
        None => {
            let found = known.iter().find(|name| is_installed(name));
            found.map(|name| (*name).to_owned()).ok_or_else(|| {
                let known = known.join(", ");
                format!("find one of the programs {known}: install it, or set `program`")
            })
        }
    }
}

/// Starts a program on the screen of the settings.
pub(crate) fn start_program(
    settings: &PlayerSettings,
    command: Vec<String>,
    scratch: Option<&Path>,
) -> Result<(RunningProgram, UnixStream), String> {
    let environment = match &settings.display {
        // A program that finds Wayland would prefer it.
        Some(display) => vec![
            ("DISPLAY".to_owned(), display.clone()),
            ("WAYLAND_DISPLAY".to_owned(), String::new()),
        ],
        None if DISPLAYS.iter().any(|name| std::env::var_os(name).is_some()) => Vec::new(),
        None => return Err("find a screen: set `display`, for instance to \":0\"".to_owned()),
    };
    let program = Program::of(command.into_iter().chain(settings.arguments.iter().cloned()));
    let program = program.ok_or("start a program without a name")?;
    let start = ProgramStart { environment: &environment, scratch, ..ProgramStart::default() };
    program.start(start).map_err(|error| error.to_string())
}

/// Returns the reason why the connection to a program was lost: the end of the program if it has
/// ended, otherwise `lost`.
pub(crate) async fn reason(program: &mut RunningProgram, lost: ScreenLinkError) -> String {
    if matches!(lost, ScreenLinkError::Crashed) {
        // The program itself goes on.
        return lost.to_string();
    }
    match tokio::time::timeout(ENDING, program.ended()).await {
        Ok(ended) => ended.to_string(),
        Err(_) => lost.to_string(),
    }
}
