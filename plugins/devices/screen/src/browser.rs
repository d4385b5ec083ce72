//! The driver `browser`: a Chromium that fills the screen.
//!
//! The driver controls the browser over a pipe (`--remote-debugging-pipe`) and not over a port,
//! because a port of the machine is open to all its users, and to every page that the browser
//! shows. The browser also ends by itself when the pipe is closed.

use std::path::Path;

use programs::RunningProgram;
use screen_link::{Browser, PageState};
use tempfile::TempDir;

use crate::content::{Content, PlayerSettings};
use crate::pages::{self, PageKind};
use crate::player::{self, Player, PlayerTrouble};

/// Names of the program, in the order in which they are tried.
const PROGRAMS: &[&str] = &["chromium", "chromium-browser", "google-chrome"];

/// Arguments of the browser: it fills the screen, asks nothing, plays films without a click, and
/// connects to no server but those of the page.
const ARGUMENTS: &[&str] = &[
    "--remote-debugging-pipe",
    "--kiosk",
    "--window-position=0,0",
    "--no-first-run",
    "--no-default-browser-check",
    "--noerrdialogs",
    "--hide-crash-restore-bubble",
    "--password-store=basic",
    "--autoplay-policy=no-user-gesture-required",
    "--disable-features=Translate",
    "--disable-breakpad",
    "--disable-crash-reporter",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "about:blank",
];

/// Number of failed checks in a row after which the page counts as not shown. A page that reloads
/// itself from time to time is away for a second.
const DOUBTS_MAX: u32 = 3;

/// A running browser, and the page that it has to show.
pub(crate) struct BrowserPlayer {
    // The program is ended before its folder is removed.
    program: RunningProgram,
    browser: Browser,
    /// Folder of the driver's own pages, and of the profile unless the config sets a profile that
    /// is kept.
    folder: TempDir,
    /// Address of the page that was shown last, as it was when the page was loaded, and the kind of
    /// the page.
    asked: (String, PageKind),
    /// Number of checks in a row that have failed.
    doubts: u32,
}

impl Player for BrowserPlayer {
    type Settings = PlayerSettings;

    async fn start(settings: &PlayerSettings) -> Result<BrowserPlayer, String> {
        let folder = tempfile::Builder::new().prefix("althing-screen-").tempdir();
        let folder = folder.map_err(|error| format!("make a folder for the browser: {error}"))?;
        let own_profile = folder.path().join("profile");
        let profile = settings.profile.as_deref().unwrap_or(&own_profile);
        let mut command = vec![player::find_program(settings, PROGRAMS)?];
        command.push(format!("--user-data-dir={}", profile.display()));
        command.extend(ARGUMENTS.iter().map(|&argument| argument.to_owned()));
        if settings.display.is_some() {
            command.push("--ozone-platform=x11".to_owned());
        }
        let (mut program, link) = player::start_program(settings, command, Some(folder.path()))?;
        let prepared = tokio::select! {
            biased;
            prepared = prepared(link, folder.path()) => prepared,
            ended = program.ended() => Err(PlayerTrouble::Program(ended.to_string())),
        };
        match prepared {
            Ok((browser, asked)) => {
                Ok(BrowserPlayer { program, browser, folder, asked, doubts: 0 })
            }
            Err(PlayerTrouble::Content(reason) | PlayerTrouble::Program(reason)) => {
                program.end().await;
                Err(reason)
            }
        }
    }

    async fn show(&mut self, content: Option<&Content>) -> Result<(), PlayerTrouble> {
        self.doubts = 0;
        self.asked = opened(&mut self.browser, self.folder.path(), content).await?;
        Ok(())
    }

    async fn check(&mut self) -> Result<(), PlayerTrouble> {
        let (address, kind) = &self.asked;
        let trouble = match self.browser.look().await {
            Ok(page) => problem(&page, address, *kind).map(|why| format!("show {address}: {why}")),
            Err(error) if error.is_of_command() => Some(error.to_string()),
            Err(error) => return Err(error.into()),
        };
        match trouble {
            None => {
                self.doubts = 0;
                Ok(())
            }
            Some(why) => {
                self.doubts += 1;
                if self.doubts < DOUBTS_MAX { Ok(()) } else { Err(PlayerTrouble::Content(why)) }
            }
        }
    }

    async fn failed(&mut self) -> String {
        let lost = self.browser.failed().await;
        player::reason(&mut self.program, lost).await
    }

    async fn end(self) {
        self.program.end().await;
    }
}

/// Attaches to the browser, makes it dark, and makes it fill the screen.
async fn prepared(
    link: tokio::net::UnixStream,
    folder: &Path,
) -> Result<(Browser, (String, PageKind)), PlayerTrouble> {
    let mut browser = Browser::attach(link).await?;
    let asked = opened(&mut browser, folder, None).await?;
    browser.fill_screen().await?;
    Ok((browser, asked))
}

/// Opens the page of a medium. Returns the address of the page when it was loaded, and its kind.
async fn opened(
    browser: &mut Browser,
    folder: &Path,
    content: Option<&Content>,
) -> Result<(String, PageKind), PlayerTrouble> {
    let (address, kind) = pages::page(folder, content)
        .map_err(|error| PlayerTrouble::Content(format!("make the page of the medium: {error}")))?;
    let page = browser.open(&address).await?;
    match problem(&page, &page.url, kind) {
        None => Ok((page.url, kind)),
        Some(why) => Err(PlayerTrouble::Content(format!("show {address}: {why}"))),
    }
}

/// Returns the reason why the page at `address` cannot be seen; `None` if it can.
fn problem(page: &PageState, address: &str, kind: PageKind) -> Option<String> {
    if let Some(why) = page.problem() {
        return Some(why);
    }
    if site(&page.url) != site(address) {
        return Some(format!("{} is shown in its place", page.url));
    }
    let film = page.film.clone().unwrap_or_default();
    if kind == PageKind::Film && !(film.has_picture && film.is_moving) {
        return Some("the film stands still".to_owned());
    }
    None
}

/// Returns the part of an address that does not change while a page is shown. Of a page on a server
/// it is the name of the server, because pages change the rest themselves; of a file it is all but
/// the part after `#`.
fn site(address: &str) -> &str {
    let address = address.split('#').next().unwrap_or_default();
    match address.split_once("://") {
        Some(("http" | "https", rest)) => {
            let host = rest.split(['/', '?']).next().unwrap_or_default();
            address.get(..address.len() - rest.len() + host.len()).unwrap_or_default()
        }
        _ => address,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_may_move_within_its_server_and_a_file_may_not() {
        for (address, expected) in [
            ("https://example.org/a/b?c=d#e", "https://example.org"),
            ("http://example.org:8080", "http://example.org:8080"),
            ("http://example.org?x=/y", "http://example.org"),
            ("file:///srv/a.pdf#view=Fit", "file:///srv/a.pdf"),
            ("about:blank", "about:blank"),
        ] {
            assert_eq!(site(address), expected);
        }
    }
}
