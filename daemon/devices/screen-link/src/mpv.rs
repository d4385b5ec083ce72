//! Controls an mpv by its JSON protocol: <https://mpv.io/manual/stable/#json-ipc>.

use std::time::Duration;

use serde_json::{Value, json};
use tokio::net::UnixStream;

use crate::frames::Frames;
use crate::{ScreenLinkError, limited};

/// Time limit for mpv to start. It is that of a small board that reads the program from a slow
/// disk.
const STARTING: Duration = Duration::from_secs(20);

/// Time limit of a command that mpv answers without a network.
const ANSWERING: Duration = Duration::from_secs(3);

/// Time limit for the first frame of a film, which may come from a network.
const LOADING: Duration = Duration::from_secs(15);

/// The connection to an mpv.
#[derive(Debug)]
pub struct Mpv {
    frames: Frames,
    last_id: u64,
    /// Number that mpv has given to the film that was loaded last.
    entry: Option<i64>,
    /// Number of the film that mpv has begun last.
    begun: Option<i64>,
    /// Whether the film that mpv has begun last has shown a frame.
    has_frame: bool,
    /// Number of the film that has ended last, and the reason of its end.
    ended: Option<(i64, String)>,
}

/// State of mpv, as mpv reports it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MpvState {
    /// Path or address of the film; `None` if there is none.
    pub path: Option<String>,
    /// Position in the film, in seconds; `None` if there is none.
    pub position: Option<f64>,
    /// Whether the film has a picture, and not only a sound.
    pub has_picture: bool,
    /// Whether the film waits for its network.
    pub is_waiting: bool,
    /// Reason why the film that was loaded last has ended; `None` if it has not.
    pub end: Option<String>,
}

impl Mpv {
    /// Waits until the mpv at the other end of `stream` answers.
    ///
    /// # Errors
    ///
    /// Returns an error if mpv does not answer in time.
    pub async fn attach(stream: UnixStream) -> Result<Mpv, ScreenLinkError> {
        let frames = Frames::new(stream, b'\n');
        let mut mpv =
            Mpv { frames, last_id: 0, entry: None, begun: None, has_frame: false, ended: None };
        limited("start mpv", STARTING, mpv.command(json!(["client_name"]))).await?;
        Ok(mpv)
    }

    /// Plays a film or shows a picture, and returns when it can be seen.
    ///
    /// # Errors
    ///
    /// Returns [`ScreenLinkError::Declined`] with mpv's reason if nothing can be seen, and another
    /// error if mpv does not answer.
    pub async fn load(&mut self, path: &str) -> Result<(), ScreenLinkError> {
        let what = format!("play {}", crate::shortened(path));
        let loading = self.quick(json!(["loadfile", path, "replace"])).await?;
        self.entry = loading["playlist_entry_id"].as_i64();
        if self.entry.is_none() {
            return Err(ScreenLinkError::declined(what, "this mpv is older than 0.33"));
        }
        match limited(&what, LOADING, self.first_frame()).await {
            Ok(()) => (),
            Err(ScreenLinkError::TimedOut { within, .. }) => {
                let why = format!("there was no picture within {within:?}");
                return Err(ScreenLinkError::declined(what, why));
            }
            Err(error) => return Err(error),
        }
        if let Some(why) = self.end() {
            return Err(ScreenLinkError::declined(what, why));
        }
        match self.look().await?.has_picture {
            true => Ok(()),
            false => Err(ScreenLinkError::declined(what, "it has a sound and no picture")),
        }
    }

    async fn first_frame(&mut self) -> Result<(), ScreenLinkError> {
        while self.end().is_none() && !(self.has_frame && self.begun == self.entry) {
            self.next().await?;
        }
        Ok(())
    }

    /// Returns the reason why the film that was loaded last has ended; `None` if it has not.
    fn end(&self) -> Option<String> {
        let (entry, why) = self.ended.as_ref()?;
        (Some(*entry) == self.entry).then(|| why.clone())
    }

    /// Ends the film; the window is black from then on.
    ///
    /// # Errors
    ///
    /// Returns an error if mpv does not answer.
    pub async fn stop(&mut self) -> Result<(), ScreenLinkError> {
        self.quick(json!(["stop"])).await.map(drop)
    }

    /// Returns what mpv shows now.
    ///
    /// # Errors
    ///
    /// Returns an error if mpv does not answer.
    pub async fn look(&mut self) -> Result<MpvState, ScreenLinkError> {
        let path = self.property("path").await?.as_str().map(str::to_owned);
        let position = self.property("time-pos").await?.as_f64();
        let has_picture = self.property("vid").await?.is_number();
        let is_waiting = self.property("paused-for-cache").await? == true;
        Ok(MpvState { path, position, has_picture, is_waiting, end: self.end() })
    }

    /// Waits until mpv closes the connection, and returns that error. Events that arrive meanwhile
    /// are handled.
    pub async fn failed(&mut self) -> ScreenLinkError {
        loop {
            if let Err(error) = self.next().await {
                return error;
            }
        }
    }

    /// Returns the value of a property; `null` if it has none at present.
    async fn property(&mut self, name: &str) -> Result<Value, ScreenLinkError> {
        match self.quick(json!(["get_property", name])).await {
            Err(ScreenLinkError::Declined { .. }) => Ok(Value::Null),
            value => value,
        }
    }

    async fn quick(&mut self, command: Value) -> Result<Value, ScreenLinkError> {
        let what = format!("have the answer of mpv to `{}`", command[0].as_str().unwrap_or(""));
        limited(&what, ANSWERING, self.command(command)).await
    }

    /// Sends a command and returns its result. Events that arrive before the result are handled.
    async fn command(&mut self, command: Value) -> Result<Value, ScreenLinkError> {
        self.last_id += 1;
        let id = self.last_id;
        let name = command[0].as_str().unwrap_or_default().to_owned();
        self.frames.send(&json!({ "command": command, "request_id": id })).await?;
        loop {
            let mut message = self.next().await?;
            if message["request_id"] != id || message.get("error").is_none() {
                continue;
            }
            return match message["error"].as_str() {
                Some("success") => Ok(message["data"].take()),
                why => {
                    let what = format!("do `{name}` in mpv");
                    Err(ScreenLinkError::declined(what, why.unwrap_or("no reason is given")))
                }
            };
        }
    }

    /// Returns the next message. If it is an event, the event is handled first.
    async fn next(&mut self) -> Result<Value, ScreenLinkError> {
        let message = self.frames.next().await?;
        let entry = message["playlist_entry_id"].as_i64();
        match message["event"].as_str() {
            Some("start-file") => {
                self.begun = entry;
                self.has_frame = false;
            }
            Some("playback-restart") => self.has_frame = true,
            Some("end-file") => {
                let why = match (message["file_error"].as_str(), message["reason"].as_str()) {
                    (Some(why), _) => crate::shortened(why),
                    (None, reason) => {
                        let reason = crate::shortened(reason.unwrap_or("no reason is given"));
                        format!("it has ended ({reason})")
                    }
                };
                self.ended = entry.map(|entry| (entry, why));
            }
            _ => (),
        }
        Ok(message)
    }
}
