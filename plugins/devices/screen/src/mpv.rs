//! The driver `mpv`: films, pictures and streams with the player of that name.
//!
//! The driver controls the player over a socket that the player inherits (`--input-ipc-client`),
//! and not over a socket in the file system. No other program can use it, and the player ends by
//! itself when the socket is closed.

use std::time::Duration;

use programs::RunningProgram;
use screen_link::{Mpv, ScreenLinkError};
use tokio::time::Instant;

use crate::content::{Content, PlayerSettings};
use crate::player::{self, Player, PlayerTrouble};

/// Names of the program.
const PROGRAMS: &[&str] = &["mpv"];

/// Arguments of the player: a black window as large as the screen, films that repeat, pictures that
/// stay, no keys, no display of its own, and nothing from a person's configuration.
const ARGUMENTS: &[&str] = &[
    "--no-config",
    "--input-ipc-client=fd://3",
    "--idle=yes",
    "--force-window=yes",
    "--fullscreen",
    "--no-border",
    "--no-terminal",
    "--no-osc",
    "--osd-level=0",
    "--cursor-autohide=always",
    "--no-input-default-bindings",
    "--input-vo-keyboard=no",
    "--load-scripts=no",
    "--ytdl=no",
    "--loop-file=inf",
    "--image-display-duration=inf",
];

/// Time for which a film may wait for its network before it counts as not shown.
const WAITING_MAX: Duration = Duration::from_secs(10);

/// A running player, and the film that it has to show.
pub(crate) struct MpvPlayer {
    program: RunningProgram,
    mpv: Mpv,
    /// Path or address of the film that the player has to show; `None` if the screen is dark.
    asked: Option<String>,
    /// Time since which the film waits for its network; `None` if it does not wait.
    waiting_since: Option<Instant>,
}

impl Player for MpvPlayer {
    type Settings = PlayerSettings;

    async fn start(settings: &PlayerSettings) -> Result<MpvPlayer, String> {
        let mut command = vec![player::find_program(settings, PROGRAMS)?];
        command.extend(ARGUMENTS.iter().map(|&argument| argument.to_owned()));
        let (mut program, link) = player::start_program(settings, command, None)?;
        match Mpv::attach(link).await {
            Ok(mpv) => Ok(MpvPlayer { program, mpv, asked: None, waiting_since: None }),
            Err(lost) => {
                let reason = player::reason(&mut program, lost).await;
                program.end().await;
                Err(reason)
            }
        }
    }

    async fn show(&mut self, content: Option<&Content>) -> Result<(), PlayerTrouble> {
        self.asked = None;
        self.waiting_since = None;
        let path = match content {
            None => return Ok(self.mpv.stop().await?),
            Some(Content::File { path, .. }) => path.to_string_lossy().into_owned(),
            Some(Content::Address(address) | Content::Fetched { address, .. }) => address.clone(),
            Some(Content::Text(_)) => {
                let why = "show a text with mpv, which shows films and pictures";
                return Err(PlayerTrouble::Content(why.to_owned()));
            }
        };
        self.mpv.load(&path).await?;
        self.asked = Some(path);
        Ok(())
    }

    async fn check(&mut self) -> Result<(), PlayerTrouble> {
        let state = self.mpv.look().await?;
        let Some(asked) = &self.asked else { return Ok(()) };
        let problem = |why: &str| Err(PlayerTrouble::Content(format!("play {asked}: {why}")));
        if state.path.as_ref() != Some(asked) {
            return problem(state.end.as_deref().unwrap_or("something else is played"));
        }
        if !state.has_picture {
            return problem("there is no picture any more");
        }
        if !state.is_waiting {
            self.waiting_since = None;
            return Ok(());
        }
        let since = *self.waiting_since.get_or_insert_with(Instant::now);
        if since.elapsed() < WAITING_MAX { Ok(()) } else { problem("nothing arrives any more") }
    }

    async fn failed(&mut self) -> String {
        let lost: ScreenLinkError = self.mpv.failed().await;
        player::reason(&mut self.program, lost).await
    }

    async fn end(self) {
        self.program.end().await;
    }
}
