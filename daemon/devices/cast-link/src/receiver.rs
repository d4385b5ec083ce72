//! What a Chromecast says about itself: the app that runs, and the television it is connected to.

use serde_json::Value;

use crate::error::excerpt;

/// Identifier of the “default media receiver”, the app that shows media for anybody.
pub(crate) const MEDIA_RECEIVER: &str = "CC1AD845";

/// State of a Chromecast.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReceiverState {
    /// App that runs; `None` if none does.
    pub app: Option<CastApp>,
    /// What the television shows, as far as the Chromecast knows.
    pub television: TelevisionState,
    /// Volume, from 0 to 1; `None` if the Chromecast does not say it.
    pub volume: Option<f64>,
}

/// An app that runs on a Chromecast.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CastApp {
    /// Identifier of the kind of app.
    pub id: String,
    /// Name of the app for people.
    pub name: String,
    /// Identifier of this run of the app.
    pub session: String,
    /// Name of the app as the receiver of messages.
    pub transport: String,
    /// Whether the app is the screen that appears if nothing is shown.
    pub is_idle_screen: bool,
}

/// What the television of a Chromecast shows. A Chromecast learns it by HDMI-CEC; many do not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TelevisionState {
    /// The Chromecast does not say it.
    #[default]
    Unknown,
    /// The television shows the Chromecast.
    ShowsChromecast,
    /// The television shows another input.
    OtherInput,
    /// The television is in standby.
    Standby,
}

impl ReceiverState {
    /// Reads the `status` of a `RECEIVER_STATUS`. What is missing or cannot be read is left out.
    pub(crate) fn of(status: &Value) -> ReceiverState {
        let app = status["applications"].get(0).map(|app| {
            let text = |key: &str| excerpt(app[key].as_str().unwrap_or_default());
            CastApp {
                id: text("appId"),
                name: text("displayName"),
                session: text("sessionId"),
                transport: text("transportId"),
                is_idle_screen: app["isIdleScreen"] == true,
            }
        });
        let (is_active, is_standby) = (&status["isActiveInput"], &status["isStandBy"]);
        let television = match (is_active.as_bool(), is_standby.as_bool()) {
            (_, Some(true)) => TelevisionState::Standby,
            (Some(false), _) => TelevisionState::OtherInput,
            (Some(true), _) => TelevisionState::ShowsChromecast,
            (None, _) => TelevisionState::Unknown,
        };
        ReceiverState { app, television, volume: status["volume"]["level"].as_f64() }
    }

    /// Returns the media receiver, if it runs and can be spoken to.
    pub(crate) fn media_receiver(&self) -> Option<&CastApp> {
        let app = self.app.as_ref()?;
        (app.id == MEDIA_RECEIVER && !app.transport.is_empty()).then_some(app)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_status_says_what_runs_and_what_the_television_shows() {
        for (status, television) in [
            (
                json!({ "isActiveInput": true, "isStandBy": false }),
                TelevisionState::ShowsChromecast,
            ),
            (json!({ "isActiveInput": false, "isStandBy": false }), TelevisionState::OtherInput),
            (json!({ "isActiveInput": true, "isStandBy": true }), TelevisionState::Standby),
            (json!({ "userEq": {} }), TelevisionState::Unknown),
            (json!([1, "x"]), TelevisionState::Unknown),
        ] {
            assert_eq!(ReceiverState::of(&status).television, television, "{status}");
        }
        let running = json!({ "applications": [
            { "appId": "CC1AD845", "sessionId": "s", "transportId": "t", "displayName": "D\u{7}" },
        ], "volume": { "level": 0.5 } });
        let state = ReceiverState::of(&running);
        let app = state.media_receiver().expect("it runs");
        assert_eq!((app.transport.as_str(), app.name.as_str()), ("t", "D "));
        assert_eq!(state.volume, Some(0.5));
        let starting = json!({ "applications": [{ "appId": "CC1AD845" }] });
        assert_eq!(ReceiverState::of(&starting).media_receiver(), None, "it has no name yet");
    }
}
