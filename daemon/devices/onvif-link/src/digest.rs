//! HTTP authentication of cameras: Digest (RFC 7616, and its predecessor RFC 2617), and Basic over
//! TLS.
//!
//! This file uses no clock, and does no input or output.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use md5::Digest as _;
use ring::digest::SHA256;

use crate::access::CameraLogin;

/// Maximum length of a challenge, in bytes; a longer one is ignored.
const CHALLENGE_BYTES_MAX: usize = 4_096;

/// A demand of a camera for a login.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Challenge {
    /// The password is sent as it is.
    Basic,
    /// The password is sent as a digest.
    Digest(DigestChallenge),
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct DigestChallenge {
    realm: String,
    nonce: String,
    opaque: Option<String>,
    has_qop: bool,
    algorithm: Algorithm,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
enum Algorithm {
    #[default]
    Md5,
    Sha256,
}

impl Challenge {
    /// Returns the strongest challenge in the values of the headers `WWW-Authenticate`; `None` if
    /// there is none that can be answered.
    pub(crate) fn strongest<'v>(values: impl Iterator<Item = &'v str>) -> Option<Challenge> {
        let mut found: Option<Challenge> = None;
        for value in values.filter(|value| value.len() <= CHALLENGE_BYTES_MAX) {
            let value = value.trim();
            let (scheme, rest) = value.split_once(' ').unwrap_or((value, ""));
            let challenge = match scheme.to_ascii_lowercase().as_str() {
                "basic" => Some(Challenge::Basic),
                "digest" => DigestChallenge::parse(rest).map(Challenge::Digest),
                _ => None,
            };
            if challenge.as_ref().map(Challenge::strength) > found.as_ref().map(Challenge::strength)
            {
                found = challenge;
            }
        }
        found
    }

    fn strength(&self) -> u8 {
        match self {
            Challenge::Basic => 0,
            Challenge::Digest(digest) => 1 + digest.algorithm as u8,
        }
    }

    /// Returns the value of the header `Authorization` for a request. `count` is the number of
    /// requests so far with this challenge, from 1; `client_nonce` is random.
    pub(crate) fn answer(
        &self,
        login: &CameraLogin,
        (method, uri): (&str, &str),
        count: u32,
        client_nonce: &str,
    ) -> String {
        match self {
            Challenge::Basic => {
                let pair = format!("{}:{}", login.user, login.password);
                format!("Basic {}", BASE64.encode(pair))
            }
            Challenge::Digest(digest) => digest.answer(login, (method, uri), count, client_nonce),
        }
    }
}

impl DigestChallenge {
    fn parse(text: &str) -> Option<DigestChallenge> {
        let mut challenge = DigestChallenge::default();
        for (key, value) in parameters(text) {
            match key.to_ascii_lowercase().as_str() {
                "realm" => challenge.realm = value,
                "nonce" => challenge.nonce = value,
                "opaque" => challenge.opaque = Some(value),
                "qop" => {
                    challenge.has_qop = value.split(',').any(|qop| qop.trim() == "auth");
                    // A digest of the body is asked for by no known camera.
                    if !challenge.has_qop {
                        return None;
                    }
                }
                "algorithm" => {
                    challenge.algorithm = match value.to_ascii_uppercase().as_str() {
                        "MD5" => Algorithm::Md5,
                        "SHA-256" => Algorithm::Sha256,
                        _ => return None,
                    };
                }
                _ => (),
            }
        }
        (!challenge.nonce.is_empty()).then_some(challenge)
    }

    fn answer(
        &self,
        login: &CameraLogin,
        (method, uri): (&str, &str),
        count: u32,
        client_nonce: &str,
    ) -> String {
        let DigestChallenge { realm, nonce, opaque, has_qop, algorithm } = self;
        let hash = |text: String| algorithm.hash(&text);
        let secret = hash(format!("{}:{realm}:{}", login.user, login.password));
        let request = hash(format!("{method}:{uri}"));
        let response = match has_qop {
            true => hash(format!("{secret}:{nonce}:{count:08x}:{client_nonce}:auth:{request}")),
            false => hash(format!("{secret}:{nonce}:{request}")),
        };
        let mut value = format!(
            "Digest username=\"{}\", realm=\"{}\", nonce=\"{}\", uri=\"{uri}\", \
             response=\"{response}\"",
            quoted(&login.user),
            quoted(realm),
            quoted(nonce)
        );
        // Writing to memory cannot fail.
        if *algorithm == Algorithm::Sha256 {
            value += ", algorithm=SHA-256";
        }
        if *has_qop {
            let _ = write!(value, ", qop=auth, nc={count:08x}, cnonce=\"{client_nonce}\"");
        }
        if let Some(opaque) = opaque {
            let _ = write!(value, ", opaque=\"{}\"", quoted(opaque));
        }
        value
    }
}

impl Algorithm {
    fn hash(self, text: &str) -> String {
        match self {
            Algorithm::Md5 => hex(&md5::Md5::digest(text.as_bytes())),
            Algorithm::Sha256 => hex(ring::digest::digest(&SHA256, text.as_bytes()).as_ref()),
        }
    }
}

pub(crate) fn hex(bytes: &[u8]) -> String {
    let mut text = String::with_capacity(2 * bytes.len());
    for byte in bytes {
        let _ = write!(text, "{byte:02x}");
    }
    text
}

fn quoted(text: &str) -> String {
    text.replace('\\', "\\\\").replace('"', "\\\"")
}

/// Returns the parameters of a challenge: `key=value` or `key="value"`, separated by commas.
fn parameters(text: &str) -> Vec<(String, String)> {
    let (mut found, mut rest) = (Vec::new(), text);
    while let Some((key, after)) = rest.split_once('=') {
        let key = key.trim_matches([',', ' ', '\t']).to_owned();
        let after = after.trim_start();
        let mut value = String::new();
        let end = match after.strip_prefix('"') {
            Some(inside) => {
                let mut symbols = inside.char_indices();
                let mut end = inside.len();
                while let Some((index, symbol)) = symbols.next() {
                    match symbol {
                        '"' => {
                            end = index + 1;
                            break;
                        }
                        '\\' => value.extend(symbols.next().map(|(_, escaped)| escaped)),
                        _ => value.push(symbol),
                    }
                }
                end + 1
            }
            None => {
                let end = after.find(',').unwrap_or(after.len());
                value = after[..end].trim().to_owned();
                end
            }
        };
        rest = after.get(end..).unwrap_or_default();
        found.push((key, value));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn login() -> CameraLogin {
        CameraLogin { user: "Mufasa".to_owned(), password: "Circle of Life".to_owned() }
    }

    fn strongest(values: &[&str]) -> Option<Challenge> {
        Challenge::strongest(values.iter().copied())
    }

    #[test]
    fn the_examples_of_the_standard_are_answered() {
        let rest = "realm=\"http-auth@example.org\", qop=\"auth, auth-int\", \
                    nonce=\"7ypf/xlj9XXwfDPEoM4URrv/xwf94BcCAzFZH4GiTo0v\", \
                    opaque=\"FQhe/qaU925kfnzjCev0ciny7QMkPqMAFRtzCUYo5tdS\"";
        let client = "f2/wE4q74E6zIJEtWaHKaf5wv/H5QzzpXusqGemxURZJ";
        for (algorithm, expected) in [
            ("MD5", "8ca523f5e9506fed4657c9700eebdbec"),
            ("SHA-256", "753927fa0e85d155564e2e272a28d1802ca10daf4496794697cf8db5856cb6c1"),
        ] {
            let value = format!("Digest {rest}, algorithm={algorithm}");
            let challenge = strongest(&[&value]).expect("a challenge");
            let answer = challenge.answer(&login(), ("GET", "/dir/index.html"), 1, client);
            assert!(answer.contains(&format!("response=\"{expected}\"")), "{answer}");
            assert!(answer.contains("nc=00000001"), "{answer}");
        }
    }

    #[test]
    fn a_challenge_without_qop_is_answered_as_of_old() {
        let value = "Digest realm=\"testrealm@host.com\",\
                     nonce=\"dcd98b7102dd2f0e8b11d0f600bfb0c093\"";
        let challenge = strongest(&[value]).expect("a challenge");
        let login = CameraLogin { password: "Circle Of Life".to_owned(), ..login() };
        let answer = challenge.answer(&login, ("GET", "/dir/index.html"), 1, "x");
        let expected = "response=\"670fd8c2df070c60b045671b8b24ff02\"";
        assert!(answer.contains(expected), "{answer}");
        assert!(!answer.contains("cnonce"), "{answer}");
    }

    #[test]
    fn the_strongest_challenge_is_chosen_and_garbage_ignored() {
        let digest = "Digest realm=\"a\", nonce=\"b\", qop=\"auth\"";
        let strong = "Digest realm=\"a\", nonce=\"b\", qop=\"auth\", algorithm=SHA-256";
        assert_eq!(strongest(&["Basic realm=\"x\""]), Some(Challenge::Basic));
        assert_eq!(strongest(&["Basic realm=x", digest]), strongest(&[digest]));
        assert_eq!(strongest(&[strong, digest]), strongest(&[strong]));
        for garbage in ["", "Digest", "Digest realm", "Digest nonce=\"", "Bearer x", "Digest ä=ä"]
        {
            assert_eq!(strongest(&[garbage]), None, "{garbage}");
        }
    }
}
