//! A connection to a Chromecast: has media shown, and follows what is shown.

use std::time::Duration;

use serde_json::{Value, json};
use tokio::time::timeout;

use crate::CastAddress;
use crate::channel::{CONNECTION, Channel, PLATFORM};
use crate::error::{CastError, excerpt};
use crate::medium::{CastMedium, MediumState, WantedMedium};
use crate::message::CastMessage;
use crate::receiver::{CastApp, MEDIA_RECEIVER, ReceiverState, TelevisionState};

/// Namespace of the messages to the device itself.
const RECEIVER: &str = "urn:x-cast:com.google.cast.receiver";

/// Namespace of the messages about media.
const MEDIA: &str = "urn:x-cast:com.google.cast.media";

/// Time limit of a command that the device carries out by itself.
const ANSWERING: Duration = Duration::from_secs(5);

/// Time limit for the start of the media receiver, which a device fetches from the internet.
const LAUNCHING: Duration = Duration::from_secs(15);

/// Time limit for a medium to be seen, which the device fetches from a network.
const LOADING: Duration = Duration::from_secs(12);

/// The connection to a Chromecast.
#[derive(Debug)]
pub struct Chromecast {
    channel: Channel,
    last_id: u32,
    receiver: ReceiverState,
    /// The media receiver that this connection speaks to; `None` if it speaks to none.
    app: Option<CastApp>,
    /// Number of the medium that the app has spoken of last.
    last_medium: Option<i64>,
    wanted: Option<WantedMedium>,
}

impl Chromecast {
    /// Connects to a Chromecast, and asks it what it does. What it shows is left as it is.
    ///
    /// # Errors
    ///
    /// Returns an error if the Chromecast cannot be reached or does not answer.
    pub async fn connect(address: &CastAddress) -> Result<Chromecast, CastError> {
        let channel = Channel::connect(address).await?;
        let mut cast = Chromecast {
            channel,
            last_id: 0,
            receiver: ReceiverState::default(),
            app: None,
            last_medium: None,
            wanted: None,
        };
        cast.channel.queue(PLATFORM, CONNECTION, &json!({ "type": "CONNECT" }));
        cast.refresh().await?;
        Ok(cast)
    }

    /// Has the Chromecast show a medium, and returns when it is shown. Whatever the Chromecast shows
    /// until then ends.
    ///
    /// # Errors
    ///
    /// Returns [`CastError::Declined`] with a reason if the medium cannot be shown, and another
    /// error if the connection is lost.
    pub async fn load(&mut self, medium: &CastMedium) -> Result<(), CastError> {
        let what = format!("show {}", excerpt(&medium.address));
        self.wanted = None;
        // The heartbeat watches the connection, so that a command that takes too long has failed.
        let late = |within| CastError::declined(&what, format!("it did not start in {within:?}"));
        let joined = timeout(LAUNCHING, self.join_media_receiver(&what)).await;
        let app = joined.unwrap_or_else(|_| Err(late(LAUNCHING)))?;
        self.wanted = Some(WantedMedium::new(medium.clone(), self.last_medium));
        let load = json!({
            "type": "LOAD",
            "sessionId": app.session,
            "media": {
                "contentId": medium.address,
                "contentType": medium.content_type,
                "streamType": "BUFFERED",
                "metadata": { "metadataType": 0 },
            },
            "autoplay": true,
            "currentTime": 0,
        });
        let seen = timeout(LOADING, self.see(&what, &app, load)).await;
        seen.unwrap_or_else(|_| Err(late(LOADING)))
    }

    /// Loads a medium, and waits until it can be seen.
    async fn see(&mut self, what: &str, app: &CastApp, load: Value) -> Result<(), CastError> {
        let answer = self.request(what, &app.transport, MEDIA, load).await?;
        if let Some(why) = refusal(&answer) {
            return Err(CastError::declined(what, why));
        }
        loop {
            match self.medium() {
                MediumState::Shown => return Ok(()),
                MediumState::Lost(why) | MediumState::Replaced(why) => {
                    return Err(CastError::declined(what, why));
                }
                MediumState::Ended => return Err(CastError::declined(what, "it ends at once")),
                MediumState::None | MediumState::Loading | MediumState::Waiting => {
                    self.advance().await?;
                }
            }
        }
    }

    /// Plays the film again that has ended.
    ///
    /// # Errors
    ///
    /// As [`Chromecast::load`].
    pub async fn repeat(&mut self) -> Result<(), CastError> {
        match self.wanted.take() {
            Some(wanted) => self.load(&wanted.medium).await,
            None => Ok(()),
        }
    }

    /// Ends the medium that was asked for, with its app. What others have begun to show is left as it
    /// is.
    ///
    /// # Errors
    ///
    /// Returns an error if the Chromecast does not answer.
    pub async fn stop(&mut self) -> Result<(), CastError> {
        let is_own = !matches!(self.medium(), MediumState::None | MediumState::Replaced(_));
        self.wanted = None;
        let Some(app) = self.app.take().filter(|_| is_own) else { return Ok(()) };
        self.last_medium = None;
        let what = "stop what is shown";
        let stop = json!({ "type": "STOP", "sessionId": app.session });
        let answer = limited(what, ANSWERING, self.request(what, PLATFORM, RECEIVER, stop)).await;
        match answer {
            // Somebody else has closed the app.
            Ok(answer) if refusal(&answer).is_some() => self.refresh().await,
            answer => answer.map(drop),
        }
    }

    /// Sets the volume, from 0 to 1.
    ///
    /// # Errors
    ///
    /// Returns an error if the Chromecast declines it or does not answer.
    pub async fn set_volume(&mut self, level: f64) -> Result<(), CastError> {
        let what = "set the volume of the Chromecast";
        let set = json!({ "type": "SET_VOLUME", "volume": { "level": level } });
        let answer = limited(what, ANSWERING, self.request(what, PLATFORM, RECEIVER, set)).await?;
        refusal(&answer).map_or(Ok(()), |why| Err(CastError::declined(what, why)))
    }

    /// Asks the Chromecast what it does, and the app what it shows.
    ///
    /// # Errors
    ///
    /// Returns an error if one of them does not answer.
    pub async fn refresh(&mut self) -> Result<(), CastError> {
        let status = || json!({ "type": "GET_STATUS" });
        let what = "ask the Chromecast what it does";
        limited(what, ANSWERING, self.request(what, PLATFORM, RECEIVER, status())).await?;
        let Some(app) = self.app.clone() else { return Ok(()) };
        let what = "ask the Chromecast what it shows";
        let asked = self.request(what, &app.transport, MEDIA, status());
        match limited(what, ANSWERING, asked).await {
            // The app was closed meanwhile, which is noted.
            Err(CastError::Declined { .. }) if self.app.is_none() => Ok(()),
            asked => asked.map(drop),
        }
    }

    /// Returns what is known of the Chromecast.
    pub fn receiver(&self) -> &ReceiverState {
        &self.receiver
    }

    /// Returns what is known of the television.
    pub fn television(&self) -> TelevisionState {
        self.receiver.television
    }

    /// Returns what is known of the medium that was asked for last.
    pub fn medium(&self) -> &MediumState {
        self.wanted.as_ref().map_or(&MediumState::None, |wanted| &wanted.state)
    }

    /// Waits until the connection is lost, and returns that error. Meanwhile follows what the
    /// Chromecast says. Nothing is lost if the future is dropped.
    pub async fn failed(&mut self) -> CastError {
        loop {
            if let Err(error) = self.advance().await {
                return error;
            }
        }
    }

    /// Closes the connection. What is shown is left as it is.
    pub async fn close(mut self) {
        self.channel.queue(PLATFORM, CONNECTION, &json!({ "type": "CLOSE" }));
        // A connection that is lost is closed, too.
        let _ = self.channel.flush().await;
    }

    /// Starts the media receiver unless it runs already, and connects to it.
    async fn join_media_receiver(&mut self, what: &str) -> Result<CastApp, CastError> {
        if self.receiver.media_receiver().is_none() {
            self.app = None;
            let launch = json!({ "type": "LAUNCH", "appId": MEDIA_RECEIVER });
            let answer = self.request(what, PLATFORM, RECEIVER, launch).await?;
            if let Some(why) = refusal(&answer) {
                let why = format!("the Chromecast does not start its media receiver: {why}");
                return Err(CastError::declined(what, why));
            }
        }
        let app = loop {
            match self.receiver.media_receiver() {
                Some(app) => break app.clone(),
                None => {
                    self.advance().await?;
                }
            }
        };
        if self.app.as_ref() != Some(&app) {
            self.channel.queue(&app.transport, CONNECTION, &json!({ "type": "CONNECT" }));
            self.app = Some(app.clone());
            self.last_medium = None;
            // The medium before this one has a number by which its last messages are known.
            let status = json!({ "type": "GET_STATUS" });
            self.request(what, &app.transport, MEDIA, status).await?;
        }
        Ok(app)
    }

    /// Sends a request and returns its answer. Messages that arrive before it are noted.
    async fn request(
        &mut self,
        what: &str,
        destination: &str,
        namespace: &str,
        mut payload: Value,
    ) -> Result<Value, CastError> {
        self.last_id += 1;
        let id = self.last_id;
        payload["requestId"] = json!(id);
        self.channel.queue(destination, namespace, &payload);
        let is_to_app = destination != PLATFORM;
        loop {
            let answer = self.advance().await?;
            if answer["requestId"] == id {
                return Ok(answer);
            }
            if is_to_app && self.app.is_none() {
                return Err(CastError::declined(what, "its app was closed"));
            }
        }
    }

    /// Waits for a message, notes what it says, and returns its payload.
    async fn advance(&mut self) -> Result<Value, CastError> {
        let message = self.channel.next().await?;
        let payload: Value = serde_json::from_str(&message.text).unwrap_or_default();
        self.note(&message, &payload)?;
        Ok(payload)
    }

    fn note(&mut self, message: &CastMessage, payload: &Value) -> Result<(), CastError> {
        let is_of_app = |app: &CastApp| app.transport == message.source;
        match (message.namespace.as_str(), payload["type"].as_str()) {
            (RECEIVER, Some("RECEIVER_STATUS")) => {
                self.receiver = ReceiverState::of(&payload["status"]);
                let running = self.receiver.app.as_ref();
                let session = running.map(|app| app.session.as_str()).unwrap_or_default();
                if self.app.as_ref().is_some_and(|app| app.session != session) {
                    let state = match running {
                        Some(other) if !other.is_idle_screen => MediumState::Replaced(format!(
                            "something else is shown in its place: {}",
                            other.name
                        )),
                        _ => closed(),
                    };
                    self.lose_app(state);
                }
            }
            (CONNECTION, Some("CLOSE")) if message.source == PLATFORM => {
                return Err(self.channel.closed());
            }
            (CONNECTION, Some("CLOSE")) if self.app.as_ref().is_some_and(is_of_app) => {
                self.lose_app(closed());
            }
            (MEDIA, Some("MEDIA_STATUS")) if self.app.as_ref().is_some_and(is_of_app) => {
                let last = payload["status"][0]["mediaSessionId"].as_i64();
                self.last_medium = last.or(self.last_medium);
                if let Some(wanted) = &mut self.wanted {
                    wanted.hear(&payload["status"]);
                }
            }
            _ => (),
        }
        Ok(())
    }

    /// Notes that the app does not run any more.
    fn lose_app(&mut self, state: MediumState) {
        self.app = None;
        self.last_medium = None;
        if let Some(wanted) = &mut self.wanted {
            wanted.state = state;
        }
    }
}

fn closed() -> MediumState {
    MediumState::Lost("its app was closed".to_owned())
}

/// Returns the reason with which a command was declined; `None` if it was not.
fn refusal(answer: &Value) -> Option<String> {
    let kind = answer["type"].as_str().unwrap_or_default();
    let why = match kind {
        "LAUNCH_ERROR" | "INVALID_REQUEST" | "INVALID_PLAYER_STATE" | "LOAD_CANCELLED" => kind,
        "LOAD_FAILED" => "the Chromecast cannot fetch or play it",
        _ => return None,
    };
    let reason = answer["reason"].as_str().map(|reason| format!(" ({reason})"));
    let code = answer["detailedErrorCode"].as_i64().map(|code| format!(" (error {code})"));
    Some(format!("{why}{}{}", reason.unwrap_or_default(), code.unwrap_or_default()))
}

/// Waits for `work` up to `within`. After that time, returns an error that names `what`.
async fn limited<T>(
    what: &str,
    within: Duration,
    work: impl Future<Output = Result<T, CastError>>,
) -> Result<T, CastError> {
    match timeout(within, work).await {
        Ok(done) => done,
        Err(_) => Err(CastError::TimedOut { what: what.to_owned(), within }),
    }
}
