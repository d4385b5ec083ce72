//! A medium that a Chromecast has to show, and what it says about it.

use serde_json::Value;

use crate::error::excerpt;

/// A medium that a Chromecast fetches by itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CastMedium {
    /// Address of the medium, which the Chromecast must reach.
    pub address: String,
    /// MIME type of the medium, such as `video/mp4`.
    pub content_type: String,
}

impl CastMedium {
    fn is_picture(&self) -> bool {
        self.content_type.starts_with("image/")
    }
}

/// What a Chromecast says about the medium that it was asked to show last.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum MediumState {
    /// No medium is asked for.
    #[default]
    None,
    /// The medium is being fetched, and nothing can be seen of it yet.
    Loading,
    /// The medium is shown. A film that a person has paused is shown, too.
    Shown,
    /// The medium is shown, and waits for further data.
    Waiting,
    /// The film has ended.
    Ended,
    /// The medium is not shown any more, for this reason.
    Lost(String),
    /// Something else is shown in place of the medium; the text says what.
    Replaced(String),
}

/// A medium that was asked for, and how it stands.
#[derive(Clone, Debug)]
pub(crate) struct WantedMedium {
    pub(crate) medium: CastMedium,
    /// Number that the app had given to the medium before this one. It never uses it again.
    before: Option<i64>,
    /// Number that the app has given to this medium; `None` if it has not said it yet.
    session: Option<i64>,
    pub(crate) state: MediumState,
}

impl WantedMedium {
    /// Creates a medium that is about to be loaded; `before` is the number of the one before.
    pub(crate) fn new(medium: CastMedium, before: Option<i64>) -> WantedMedium {
        WantedMedium { medium, before, session: None, state: MediumState::Loading }
    }

    /// Takes note of a `MEDIA_STATUS` of the app.
    ///
    /// A status has only what has changed, so that it names its medium by the address or by the
    /// number. Statuses of the medium before may still arrive while this one is loaded, and the two
    /// may have the same address.
    pub(crate) fn hear(&mut self, statuses: &Value) {
        let Some(status) = statuses.get(0) else {
            // The app plays nothing; it has said the reason before, or a medium is yet to begin.
            if self.is_seen() {
                self.state = MediumState::Lost("nothing is played any more".to_owned());
            }
            return;
        };
        let next = &status["extendedStatus"];
        if next["playerState"] == "LOADING" {
            match self.is_about(next) {
                Some(true) => self.session = next["mediaSessionId"].as_i64(),
                Some(false) => self.replaced("something else is loaded in its place"),
                None => (),
            }
            return;
        }
        if self.before.is_some() && status["mediaSessionId"].as_i64() == self.before {
            return;
        }
        match self.is_about(status) {
            Some(true) => self.adopt(status),
            Some(false) => self.replaced("something else is played in its place"),
            None => (),
        }
    }

    /// Returns whether the status is about this medium; `None` if it does not say it.
    fn is_about(&self, status: &Value) -> Option<bool> {
        let media = &status["media"];
        let address = media["contentId"].as_str().or(media["contentUrl"].as_str());
        if let Some(address) = address {
            return Some(address == self.medium.address);
        }
        let session = status["mediaSessionId"].as_i64()?;
        self.session.map(|own| own == session)
    }

    fn adopt(&mut self, status: &Value) {
        if let Some(session) = status["mediaSessionId"].as_i64() {
            self.session = Some(session);
        }
        let lost = |why: &str| MediumState::Lost(why.to_owned());
        self.state = match (status["playerState"].as_str(), status["idleReason"].as_str()) {
            (Some("PLAYING" | "PAUSED"), _) => MediumState::Shown,
            (Some("BUFFERING"), _) => MediumState::Waiting,
            (Some("LOADING"), _) => MediumState::Loading,
            (Some("IDLE"), Some("FINISHED")) => MediumState::Ended,
            (Some("IDLE"), Some("ERROR")) => lost("the Chromecast cannot fetch or play it"),
            (Some("IDLE"), Some("CANCELLED")) => lost("it was stopped at another device"),
            (Some("IDLE"), Some("INTERRUPTED")) => {
                MediumState::Replaced("something else was loaded".to_owned())
            }
            (Some("IDLE"), Some(other)) => MediumState::Lost(excerpt(other)),
            // A picture does not move, so that nothing is played when it is shown.
            (Some("IDLE"), None) if self.medium.is_picture() => MediumState::Shown,
            _ => return,
        };
    }

    /// Notes that another medium is there. The one before this one does not count.
    fn replaced(&mut self, why: &str) {
        if self.is_seen() || self.state == MediumState::Ended {
            self.state = MediumState::Replaced(why.to_owned());
        }
    }

    fn is_seen(&self) -> bool {
        matches!(self.state, MediumState::Shown | MediumState::Waiting)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn wanted(content_type: &str) -> WantedMedium {
        let (address, content_type) = ("http://a/b".to_owned(), content_type.to_owned());
        WantedMedium::new(CastMedium { address, content_type }, Some(3))
    }

    fn status(session: i64, address: &str, state: &str, reason: Value) -> Value {
        let mut status = json!({ "mediaSessionId": session, "playerState": state });
        if !address.is_empty() {
            status["media"] = json!({ "contentId": address });
        }
        if !reason.is_null() {
            status["idleReason"] = reason;
        }
        json!([status])
    }

    #[test]
    fn the_statuses_of_the_medium_before_do_not_count() {
        let mut film = wanted("video/mp4");
        for before in [
            json!([]),
            status(3, "http://old/", "PLAYING", Value::Null),
            status(3, "", "IDLE", json!("INTERRUPTED")),
            status(3, "http://a/b", "IDLE", json!("CANCELLED")),
            status(3, "http://a/b", "PLAYING", Value::Null),
        ] {
            film.hear(&before);
            assert_eq!(film.state, MediumState::Loading, "{before}");
        }
        let mut loading = status(3, "http://old/", "IDLE", json!("INTERRUPTED"));
        loading[0]["extendedStatus"] = json!({
            "playerState": "LOADING", "mediaSessionId": 4, "media": { "contentId": "http://a/b" },
        });
        film.hear(&loading);
        assert_eq!(film.state, MediumState::Loading);
        film.hear(&status(4, "", "PLAYING", Value::Null));
        assert_eq!(film.state, MediumState::Shown);
    }

    #[test]
    fn each_way_in_which_a_medium_ends_has_a_reason() {
        for (heard, expected) in [
            (json!([]), "nothing is played any more"),
            (status(1, "", "IDLE", json!("ERROR")), "the Chromecast cannot fetch or play it"),
            (status(1, "", "IDLE", json!("CANCELLED")), "it was stopped at another device"),
            (status(1, "", "IDLE", json!("INTERRUPTED")), "something else was loaded"),
            (status(1, "", "IDLE", json!("NEW\n")), "NEW "),
            (status(2, "http://c/", "PLAYING", Value::Null), "something else is played"),
            (status(2, "", "PLAYING", Value::Null), "something else is played"),
        ] {
            let mut film = wanted("video/mp4");
            film.hear(&status(1, "http://a/b", "PLAYING", Value::Null));
            assert_eq!(film.state, MediumState::Shown);
            film.hear(&heard);
            let (MediumState::Lost(why) | MediumState::Replaced(why)) = &film.state else {
                panic!("{heard}: {:?}", film.state)
            };
            assert!(why.contains(expected), "{why}");
        }
        let mut film = wanted("video/mp4");
        film.hear(&status(1, "http://a/b", "PLAYING", Value::Null));
        for (heard, expected) in [
            (status(1, "", "BUFFERING", Value::Null), MediumState::Waiting),
            (status(1, "", "PAUSED", Value::Null), MediumState::Shown),
            (status(1, "", "IDLE", json!("FINISHED")), MediumState::Ended),
            (json!([]), MediumState::Ended),
        ] {
            film.hear(&heard);
            assert_eq!(film.state, expected);
        }
    }

    #[test]
    fn a_picture_is_shown_when_it_is_not_loaded_any_more() {
        for (content_type, expected) in
            [("image/png", MediumState::Shown), ("video/mp4", MediumState::Loading)]
        {
            let mut medium = wanted(content_type);
            medium.hear(&status(1, "http://a/b", "IDLE", Value::Null));
            assert_eq!(medium.state, expected);
        }
    }

    #[test]
    fn garbage_changes_nothing() {
        let mut film = wanted("video/mp4");
        for heard in [json!(null), json!([1]), json!([{ "media": 3 }]), json!({ "a": [] })] {
            film.hear(&heard);
            assert_eq!(film.state, MediumState::Loading);
        }
    }
}
