//! The cookies of a server: that of a session, and that of the screen of an agent.

use axum::http::header::{self, HeaderMap, HeaderValue};

/// How long a browser keeps the cookie of a screen after the last use, in seconds: 400 days, the
/// longest that browsers allow. A screen has nobody who signs in again.
const SCREEN_KEPT_SECONDS: u64 = 400 * 24 * 3_600;

/// The names of the cookies. Browsers send the cookies of a host to all its ports, so the names are
/// those of one daemon: two daemons of one machine do not take each other's sessions away.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct CookieNames {
    session: String,
    screen: String,
    is_encrypted: bool,
}

impl CookieNames {
    /// Returns the names for the page of a daemon. Over TLS a browser takes a cookie with the prefix
    /// `__Host-` only from the host itself, so that no other machine of its domain can set it.
    pub(crate) fn new(ecosystem: &str, daemon: &str, is_encrypted: bool) -> CookieNames {
        let prefix = if is_encrypted { "__Host-althing" } else { "althing" };
        CookieNames {
            session: format!("{prefix}-{ecosystem}-{daemon}"),
            screen: format!("{prefix}-screen-{ecosystem}-{daemon}"),
            is_encrypted,
        }
    }

    /// Returns the secret of a session; `None` if there is no cookie or more than one.
    pub(crate) fn session<'h>(&self, headers: &'h HeaderMap) -> Option<&'h str> {
        only(headers, &self.session)
    }

    /// Returns the token of a screen; `None` if there is no cookie or more than one.
    pub(crate) fn screen<'h>(&self, headers: &'h HeaderMap) -> Option<&'h str> {
        only(headers, &self.screen)
    }

    /// Returns the header that gives a browser the secret of its session, or takes it away.
    pub(crate) fn set_session(&self, secret: Option<&str>) -> Option<HeaderValue> {
        let age = if secret.is_some() { "" } else { "; Max-Age=0" };
        self.header(&self.session, secret.unwrap_or_default(), age)
    }

    /// Returns the header that gives the browser of a screen its token.
    pub(crate) fn set_screen(&self, token: &str) -> Option<HeaderValue> {
        self.header(&self.screen, token, &format!("; Max-Age={SCREEN_KEPT_SECONDS}"))
    }

    fn header(&self, name: &str, value: &str, age: &str) -> Option<HeaderValue> {
        let secure = if self.is_encrypted { "; Secure" } else { "" };
        let text = format!("{name}={value}; Path=/; HttpOnly; SameSite=Strict{secure}{age}");
        let mut header = HeaderValue::from_str(&text).ok()?;
        header.set_sensitive(true);
        Some(header)
    }
}

fn only<'h>(headers: &'h HeaderMap, name: &str) -> Option<&'h str> {
    let texts = headers.get_all(header::COOKIE).iter().filter_map(|text| text.to_str().ok());
    let pairs = texts.flat_map(|text| text.split(';')).filter_map(|pair| pair.split_once('='));
    let mut values = pairs.filter(|(known, _)| known.trim() == name).map(|(_, it)| it.trim());
    let value = values.next()?;
    values.next().is_none().then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_one_cookie_of_the_right_name_counts() {
        let secret = |cookies: &[&'static str], encrypted| {
            let mut headers = HeaderMap::new();
            for cookie in cookies {
                headers.append(header::COOKIE, HeaderValue::from_static(cookie));
            }
            CookieNames::new("home", "pi", encrypted).session(&headers).map(str::to_owned)
        };
        assert_eq!(secret(&["a=b; althing-home-pi=x; c"], false).as_deref(), Some("x"));
        assert_eq!(secret(&["a=b", "althing-home-pi=x"], false).as_deref(), Some("x"));
        assert_eq!(secret(&["althing-home-pi=x; althing-home-pi=y"], false), None);
        assert_eq!(secret(&["althing-home-pi=x"], true), None);
        assert_eq!(secret(&["__Host-althing-home-pi=x"], true).as_deref(), Some("x"));
        assert_eq!(secret(&[], true), None);
    }

    #[test]
    fn daemons_of_one_machine_have_cookies_of_their_own() {
        let of = |daemon| {
            let names = CookieNames::new("home", daemon, false);
            let header = names.set_session(Some("secret")).expect("a header");
            let pair = header.to_str().expect("a text").split(';').next().map(str::to_owned);
            (names, pair.expect("a name and a value"))
        };
        let ((hall, of_hall), (attic, of_attic)) = (of("hall"), of("attic"));
        let mut headers = HeaderMap::new();
        for pair in [of_hall, of_attic.replace("secret", "other")] {
            headers.append(header::COOKIE, HeaderValue::from_str(&pair).expect("a header"));
        }
        assert_eq!(hall.session(&headers), Some("secret"));
        assert_eq!(attic.session(&headers), Some("other"));
        assert_eq!(hall.screen(&headers), None, "a session is no screen");
    }
}
