//! The driver `cast`: a Chromecast, or a television that can do the same.
//!
//! The device belongs to all people of the network, so that the driver leaves alone what others have
//! begun to show: connecting changes nothing, and only a medium of this driver is ever stopped.

use std::net::IpAddr;
use std::time::Duration;

use cast_link::{CastAddress, CastError, CastMedium, Chromecast, MediumState, TelevisionState};
use tokio::time::Instant;

use crate::content::{ADDRESSES, Content};
use crate::player::{Player, PlayerTrouble};

/// Pause between two questions what the device does and shows. In between it says by itself what
/// changes; the question finds out what it has not said.
const ASKING: Duration = Duration::from_secs(5);

/// Time for which a medium may wait for the network of the device before it counts as not shown.
const WAITING_MAX: Duration = Duration::from_secs(15);

/// Time for a television to turn on and to switch to the device.
const SWITCHING_MAX: Duration = Duration::from_secs(15);

/// Types of media by the endings of their addresses.
const TYPES: &[(&[&str], &str)] = &[
    (&["mp4", "m4v"], "video/mp4"),
    (&["webm"], "video/webm"),
    (&["m3u8"], "application/x-mpegURL"),
    (&["mpd"], "application/dash+xml"),
    (&["jpg", "jpeg"], "image/jpeg"),
    (&["png"], "image/png"),
    (&["gif"], "image/gif"),
    (&["bmp"], "image/bmp"),
    (&["webp"], "image/webp"),
    (&["mp3"], "audio/mpeg"),
    (&["m4a"], "audio/mp4"),
    (&["aac"], "audio/aac"),
    (&["oga", "ogg", "opus"], "audio/ogg"),
    (&["wav"], "audio/wav"),
    (&["flac"], "audio/flac"),
];

/// Settings of the driver `cast`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct CastSettings {
    pub(crate) address: CastAddress,
    /// Volume with which media are presented; `None` leaves it as it is.
    pub(crate) volume: Option<f64>,
    /// Whether the driver ignores what the device says about its television.
    pub(crate) ignores_cec: bool,
}

/// Returns the medium at an address whose ending says its type.
///
/// # Errors
///
/// Returns the reason why it is no medium for a Chromecast.
pub(crate) fn plain_content(address: &str) -> Result<Content, String> {
    check_address(address)?;
    let path = address.split(['?', '#']).next().unwrap_or_default();
    let ending = path.rsplit('/').next().and_then(|name| name.rsplit_once('.'));
    let ending = ending.map(|(_, ending)| ending.to_lowercase()).unwrap_or_default();
    let known = TYPES.iter().find(|(endings, _)| endings.contains(&ending.as_str()));
    let Some((_, content_type)) = known else {
        return Err(format!(
            "the ending of {address} does not say what it is, and a Chromecast has to be told: \
             write {{ address = \"{address}\", type = \"video/mp4\" }} with the right type; a \
             Chromecast shows films, pictures and sound, and no pages or PDFs"
        ));
    };
    let (address, content_type) = (address.to_owned(), (*content_type).to_owned());
    Ok(Content::Fetched { address, content_type })
}

/// Returns the medium at an address with a type.
///
/// # Errors
///
/// Returns the reason why it is no medium for a Chromecast.
pub(crate) fn typed_content(address: &str, content_type: &str) -> Result<Content, String> {
    check_address(address)?;
    let kind = content_type.split_once('/').map(|(kind, _)| kind);
    if !matches!(kind, Some("video" | "image" | "audio" | "application")) {
        return Err(format!(
            "the type `{content_type}` is not one of video/…, image/…, audio/… or application/…"
        ));
    }
    let (address, content_type) = (address.to_owned(), content_type.to_owned());
    Ok(Content::Fetched { address, content_type })
}

/// Whether an address means the machine that asks for it, such as `http://localhost:8000/film.mp4`.
pub(crate) fn is_own_machine(address: &str) -> bool {
    let authority = address.split_once("://").map_or(address, |(_, rest)| rest);
    let authority = authority.split(['/', '?', '#']).next().unwrap_or_default();
    let host = authority.rsplit('@').next().unwrap_or_default();
    let host = match host.strip_prefix('[') {
        Some(inner) => inner.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    let is_own = |ip: IpAddr| ip.is_loopback() || ip.is_unspecified();
    host.eq_ignore_ascii_case("localhost") || host.parse().is_ok_and(is_own)
}

fn check_address(address: &str) -> Result<(), String> {
    if ADDRESSES.iter().any(|start| address.starts_with(start)) {
        return Ok(());
    }
    Err("a Chromecast fetches its media by itself: write an address that begins with `http://` or \
         `https://`. It shows no texts, and no files of this machine"
        .to_owned())
}

/// A connection to a Chromecast, and what it has to show.
pub(crate) struct CastPlayer {
    cast: Chromecast,
    settings: CastSettings,
    /// Address of the medium that was asked for last.
    address: String,
    /// Time when the device was asked last what it shows.
    asked: Instant,
    /// Time since which the medium waits for the network; `None` if it does not wait.
    waiting_since: Option<Instant>,
    /// Time since which the television shows something else; `None` if it does not.
    away_since: Option<Instant>,
}

impl Player for CastPlayer {
    type Settings = CastSettings;

    async fn start(settings: &CastSettings) -> Result<CastPlayer, String> {
        let cast = Chromecast::connect(&settings.address).await;
        Ok(CastPlayer {
            cast: cast.map_err(|error| error.to_string())?,
            settings: settings.clone(),
            address: String::new(),
            asked: Instant::now(),
            waiting_since: None,
            away_since: None,
        })
    }

    async fn show(&mut self, content: Option<&Content>) -> Result<(), PlayerTrouble> {
        (self.waiting_since, self.away_since) = (None, None);
        let Some(content) = content else { return Ok(self.cast.stop().await?) };
        let Content::Fetched { address, content_type } = content else {
            let why = format!("show {}: a Chromecast shows media at addresses", content.written());
            return Err(PlayerTrouble::Content(why));
        };
        self.address.clone_from(address);
        if let Some(volume) = self.settings.volume {
            self.cast.set_volume(volume).await?;
        }
        let (address, content_type) = (address.clone(), content_type.clone());
        Ok(self.cast.load(&CastMedium { address, content_type }).await?)
    }

    async fn check(&mut self) -> Result<(), PlayerTrouble> {
        if self.asked.elapsed() >= ASKING {
            self.asked = Instant::now();
            self.cast.refresh().await?;
        }
        match self.cast.medium() {
            MediumState::None => return Ok(()),
            MediumState::Shown => self.waiting_since = None,
            MediumState::Ended => self.cast.repeat().await?,
            MediumState::Lost(why) | MediumState::Replaced(why) => {
                let why = format!("show {}: {why}", self.address);
                return Err(PlayerTrouble::Content(why));
            }
            MediumState::Loading | MediumState::Waiting => {
                let since = *self.waiting_since.get_or_insert_with(Instant::now);
                if since.elapsed() >= WAITING_MAX {
                    let why = format!("show {}: nothing arrives any more", self.address);
                    return Err(PlayerTrouble::Content(why));
                }
            }
        }
        self.check_television()
    }

    async fn failed(&mut self) -> String {
        self.cast.failed().await.to_string()
    }

    async fn end(mut self) {
        // What cannot be stopped any more is lost already, with its reason in the log.
        if self.cast.stop().await.is_ok() {
            self.cast.close().await;
        }
    }
}

impl CastPlayer {
    /// Checks that the television does not show something else. A television that is turned on by
    /// the medium needs a moment.
    fn check_television(&mut self) -> Result<(), PlayerTrouble> {
        let why = match self.cast.television() {
            _ if self.settings.ignores_cec => None,
            TelevisionState::Unknown | TelevisionState::ShowsChromecast => None,
            TelevisionState::OtherInput => Some("the television shows another input"),
            TelevisionState::Standby => Some("the television is in standby"),
        };
        let Some(why) = why else {
            self.away_since = None;
            return Ok(());
        };
        let since = *self.away_since.get_or_insert_with(Instant::now);
        if since.elapsed() < SWITCHING_MAX {
            return Ok(());
        }
        Err(PlayerTrouble::Content(format!("show {}: {why}", self.address)))
    }
}

impl From<CastError> for PlayerTrouble {
    fn from(error: CastError) -> PlayerTrouble {
        match error.is_of_command() {
            true => PlayerTrouble::Content(error.to_string()),
            false => PlayerTrouble::Program(error.to_string()),
        }
    }
}
