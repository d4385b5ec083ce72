//! Video streams of cameras (RTSP): their addresses, and the login for them.

use std::fmt::{self, Display, Formatter, Write as _};
use std::net::IpAddr;
use std::path::PathBuf;

use crate::access::{CameraLogin, read_login};
use crate::camera::OnvifCamera;
use crate::error::{LinkError, excerpt};
use crate::services::{MEDIA, call};
use crate::xml::{Element, escape};

/// Port of RTSP.
const PORT: u16 = 554;

/// Maximum length of an address, in bytes; a longer one is refused.
const ADDRESS_BYTES_MAX: usize = 1_024;

/// Symbols that an address may contain besides letters and digits: those of a URL without a login,
/// and none with a meaning in configuration files or in quotes.
const SYMBOLS: &str = "-._~:/?[]!$&()*+,;=%";

/// Transport of the old media service, and protocol of the new one: RTSP, each connection to one
/// receiver.
const OLD_SETUP: &str = "<o:StreamSetup><tt:Stream>RTP-Unicast</tt:Stream><tt:Transport>\
                         <tt:Protocol>RTSP</tt:Protocol></tt:Transport></o:StreamSetup>";
const NEW_SETUP: &str = "<o:Protocol>RTSP</o:Protocol>";

/// Address of a video stream of a config, and the file with the password for it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StreamAccess {
    address: String,
    login: Option<(String, Option<PathBuf>)>,
}

/// A video stream, with the login for it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VideoStream {
    address: String,
    login: Option<CameraLogin>,
}

impl StreamAccess {
    /// Returns the access for an entry in a config. `address` is `rtsp://HOST/PATH`, or an address
    /// with one of the other `schemes`.
    ///
    /// # Errors
    ///
    /// Returns an error with the mistake in the entry and its correction.
    pub fn new(
        address: &str,
        schemes: &[&str],
        user: Option<String>,
        password_file: Option<PathBuf>,
    ) -> Result<StreamAccess, String> {
        let scheme = address.split_once("://").map_or("", |(scheme, _)| scheme);
        if !schemes.contains(&scheme) {
            // The text may contain a password.
            let known = schemes.iter().map(|scheme| format!("{scheme}://…")).collect::<Vec<_>>();
            return Err(format!("the address of a video is {}", known.join(" or ")));
        }
        check(address)?;
        let login = match (user, password_file) {
            (Some(user), _) if user.is_empty() || user.chars().any(char::is_control) => {
                return Err("`user` is empty, or has a control character".to_owned());
            }
            (_, Some(file)) if file.is_relative() => {
                return Err("`password-file` needs an absolute path".to_owned());
            }
            (Some(user), file) => Some((user, file)),
            (None, Some(_)) => return Err("a `password-file` needs its `user`".to_owned()),
            (None, None) => None,
        };
        Ok(StreamAccess { address: address.to_owned(), login })
    }

    /// Reads the password from its file.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be read, or contains no password.
    pub fn read(&self) -> Result<VideoStream, LinkError> {
        let login = self.login.as_ref().map(|(user, file)| read_login(user, file.as_deref()));
        Ok(VideoStream { address: self.address.clone(), login: login.transpose()? })
    }
}

impl Display for StreamAccess {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(&self.address)
    }
}

impl VideoStream {
    /// Returns the address without the login.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Returns the user name and the password as they stand in an address; `None` if the stream needs
    /// no login. The text is a secret.
    pub fn encoded_login(&self) -> Option<(String, String)> {
        self.login.as_ref().map(|login| (encoded(&login.user), encoded(&login.password)))
    }

    /// Returns the user name and the password; `None` if the stream needs no login.
    pub fn login(&self) -> Option<(&str, &str)> {
        self.login.as_ref().map(|login| (login.user.as_str(), login.password.as_str()))
    }

    /// Returns the address with the login. The text is a secret: it must not reach a log, an error,
    /// or the arguments of a program.
    pub fn secret_address(&self) -> String {
        match (self.address.split_once("://"), self.encoded_login()) {
            (Some((scheme, rest)), Some((user, password))) => {
                format!("{scheme}://{user}:{password}@{rest}")
            }
            _ => self.address.clone(),
        }
    }
}

impl OnvifCamera {
    /// Reads the address of the camera's video. The host is always that of the config.
    ///
    /// # Errors
    ///
    /// Returns an error if the camera does not answer, or names no RTSP address.
    pub async fn video_stream(&self) -> Result<VideoStream, LinkError> {
        let name = "GetStreamUri";
        let setup = if self.media_namespace == MEDIA { OLD_SETUP } else { NEW_SETUP };
        let content = format!("{setup}<o:ProfileToken>{}</o:ProfileToken>", escape(&self.profile));
        let answer = call(&self.session, &self.media, self.media_namespace, name, &content).await?;
        let named = answer.find("Uri").map(Element::text).unwrap_or_default();
        let host = &self.session.address().host;
        let address = resolve(named, host, self.session.peer()).ok_or_else(|| {
            let problem = "it names no RTSP address of a video".to_owned();
            LinkError::Unreadable { call: name.to_owned(), problem }
        })?;
        Ok(VideoStream { address, login: self.session.login().cloned() })
    }
}

/// Checks that an address is a URL without a login.
fn check(address: &str) -> Result<(), String> {
    if address.len() > ADDRESS_BYTES_MAX {
        return Err(format!("the address of a video is longer than {ADDRESS_BYTES_MAX} bytes"));
    }
    if address.contains('@') {
        return Err(
            "the address of a video: write `user` and `password-file` beside it: this file \
                    is no secret"
                .to_owned(),
        );
    }
    let is_allowed = |symbol: char| symbol.is_ascii_alphanumeric() || SYMBOLS.contains(symbol);
    match address.chars().find(|symbol| !is_allowed(*symbol)) {
        Some(symbol) => Err(format!(
            "the address of a video `{}` has the symbol {symbol:?}; write it as % and two digits",
            excerpt(address)
        )),
        None => Ok(()),
    }
}

/// Returns the RTSP address for the text `named` of a camera, at the host of the config. The port
/// that the camera names counts only together with this host, or the IP address `peer` of it.
fn resolve(named: &str, host: &str, peer: Option<IpAddr>) -> Option<String> {
    let rest = named.trim().strip_prefix("rtsp://")?;
    let (authority, path) = rest.split_at(rest.find(['/', '?']).unwrap_or(rest.len()));
    // Some cameras put a login into the address.
    let authority = authority.rsplit_once('@').map_or(authority, |(_, authority)| authority);
    let port_at = authority.rfind(':').filter(|at| !authority[*at..].contains(']'));
    let (named_host, port) = authority.split_at(port_at.unwrap_or(authority.len()));
    let named_host = named_host.trim_start_matches('[').trim_end_matches(']');
    let is_here = named_host.eq_ignore_ascii_case(host)
        || named_host.parse::<IpAddr>().is_ok_and(|named| Some(named) == peer);
    let port = port.strip_prefix(':').and_then(|port| port.parse().ok());
    let port: u16 = port.filter(|port| is_here && *port != 0).unwrap_or(PORT);
    let host = if host.contains(':') { format!("[{host}]") } else { host.to_owned() };
    let address = format!("rtsp://{host}:{port}{path}");
    check(&address).is_ok().then_some(address)
}

/// Returns a text as it stands in the login of a URL.
fn encoded(text: &str) -> String {
    let mut encoded = String::new();
    for byte in text.bytes() {
        if byte.is_ascii_alphanumeric() || b"-._~".contains(&byte) {
            encoded.push(char::from(byte));
        } else {
            // Writing to memory cannot fail.
            let _ = write!(encoded, "%{byte:02X}");
        }
    }
    encoded
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_video_is_always_at_the_host_of_the_config() {
        let peer = "10.0.0.9".parse().ok();
        for (named, expected) in [
            ("rtsp://cam:8554/live?ch=1&x=2", Some("rtsp://cam:8554/live?ch=1&x=2")),
            ("rtsp://10.0.0.9:8554/live", Some("rtsp://cam:8554/live")),
            ("rtsp://me:secret@cam/live", Some("rtsp://cam:554/live")),
            ("rtsp://192.168.1.5:8554/live", Some("rtsp://cam:554/live")),
            ("rtsp://[::1]:8554?x", Some("rtsp://cam:554?x")),
            ("rtsp://cam:99999/live", Some("rtsp://cam:554/live")),
            ("http://cam/live", None),
            ("rtsp://cam/live'\nfile", None),
            ("", None),
        ] {
            assert_eq!(resolve(named, "cam", peer).as_deref(), expected, "{named}");
        }
        assert_eq!(resolve("rtsp://[::1]/x", "::1", None).as_deref(), Some("rtsp://[::1]:554/x"));
    }

    #[test]
    fn a_password_is_in_the_secret_address_only() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("password");
        std::fs::write(&file, "p@ss:w/ö\n").expect("a file");
        let access =
            StreamAccess::new("rtsp://cam/1", &["rtsp"], Some("me".to_owned()), Some(file));
        let stream = access.expect("it is right").read().expect("the file is there");
        assert_eq!(stream.secret_address(), "rtsp://me:p%40ss%3Aw%2F%C3%B6@cam/1");
        assert_eq!(stream.login(), Some(("me", "p@ss:w/ö")));
        assert!(!format!("{stream:?} {}", stream.address()).contains("p@ss"), "{stream:?}");
    }

    #[test]
    fn a_wrong_address_is_refused_without_its_password() {
        let user = || Some("me".to_owned());
        for (address, user, file, expected) in [
            ("cam/1", None, None, "is rtsp://…"),
            ("https://a:hunter2@cam", None, None, "is rtsp://…"),
            ("rtsp://a:hunter2@cam/1", None, None, "write `user` and `password-file`"),
            ("rtsp://cam/a b", None, None, "has the symbol ' '"),
            ("rtsp://cam/\n", None, None, "has the symbol '\\n'"),
            ("rtsp://cam/1", None, Some("/x".into()), "needs its `user`"),
            ("rtsp://cam/1", user(), Some("x".into()), "needs an absolute path"),
            ("rtsp://cam/1", Some("a\nb".to_owned()), None, "a control character"),
        ] {
            let problem = StreamAccess::new(address, &["rtsp"], user, file).expect_err(address);
            assert!(problem.contains(expected) && !problem.contains("hunter2"), "{problem}");
        }
    }
}
