//! How a camera is reached: its address, its login, and the certificates that it may show.

use std::fmt::{self, Debug, Display, Formatter};
use std::io::Read as _;
use std::net::IpAddr;
use std::path::{Path, PathBuf};

use crate::address::Address;
use crate::error::LinkError;

/// Maximum size of a file with a password or certificates, in bytes; a longer file is an error.
const FILE_BYTES_MAX: u64 = 1 << 20;

/// Bytes of a SHA-256 fingerprint.
const FINGERPRINT_BYTES: usize = 32;

/// Address of a camera, and the files with its credentials. The password is read from its file at
/// each attempt to connect, and is never stored in this value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CameraAccess {
    pub(crate) address: Address,
    pub(crate) login: Option<(String, Option<PathBuf>)>,
    pub(crate) trust: Option<TrustedCertificate>,
}

/// The certificates that a camera may show.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum TrustedCertificate {
    /// One that an authority in this file has signed, or that is itself in this file (PEM).
    File(PathBuf),
    /// The one with this SHA-256 fingerprint.
    Fingerprint([u8; FINGERPRINT_BYTES]),
}

impl CameraAccess {
    /// Returns the access for an entry in a config. `address` has the form `HOST`, `HOST:PORT`,
    /// `http://…` or `https://…`. `user` and `password_file` are the login. A camera with `https`
    /// needs either `ca`, a file with its certificate or the certificates of the trusted
    /// authorities (PEM), or the SHA-256 `fingerprint` of its certificate in hexadecimal digits.
    ///
    /// # Errors
    ///
    /// Returns an error with the mistake in the entry and its correction.
    pub fn new(
        address: &str,
        user: Option<String>,
        password_file: Option<PathBuf>,
        ca: Option<PathBuf>,
        fingerprint: Option<&str>,
    ) -> Result<CameraAccess, String> {
        let address = Address::parse(address)?;
        let wrong = |problem: &str| Err(format!("camera `{address}`: {problem}"));
        for (key, file) in [("password-file", &password_file), ("ca", &ca)] {
            if file.as_ref().is_some_and(|file| file.is_relative()) {
                return wrong(&format!("`{key}` needs an absolute path"));
            }
        }
        let login = match (user, password_file) {
            (Some(user), _) if user.chars().any(|symbol| symbol.is_control() || symbol == '"') => {
                return wrong("`user` has a quotation mark or a control character");
            }
            (Some(user), password_file) => Some((user, password_file)),
            (None, Some(_)) => return wrong("a `password-file` needs its `user`"),
            (None, None) => None,
        };
        let trust = match (ca, fingerprint) {
            (Some(_), Some(_)) => return wrong("write `ca` or `fingerprint`, and not both"),
            (Some(ca), None) => Some(TrustedCertificate::File(ca)),
            (None, Some(text)) => match fingerprint_of(text) {
                Some(fingerprint) => Some(TrustedCertificate::Fingerprint(fingerprint)),
                None => {
                    return wrong(
                        "`fingerprint` is the SHA-256 of its certificate, 64 hexadecimal digits: \
                         openssl x509 -noout -fingerprint -sha256",
                    );
                }
            },
            (None, None) => None,
        };
        if address.is_encrypted != trust.is_some() {
            return wrong(match address.is_encrypted {
                true => {
                    "name the certificate to trust: ca = \"/etc/althing/camera.pem\", \
                     or its SHA-256 `fingerprint`"
                }
                false => "`ca` and `fingerprint` are for TLS; write https://HOST:PORT",
            });
        }
        Ok(CameraAccess { address, login, trust })
    }

    /// Returns a warning for a person if the connection to the camera is not protected. Returns
    /// `None` if it is protected, or stays on this machine.
    pub fn risk(&self) -> Option<&'static str> {
        let host = &self.address.host;
        let is_here = host == "localhost" || host.parse().is_ok_and(|ip: IpAddr| ip.is_loopback());
        let is_open = !self.address.is_encrypted && !is_here;
        is_open.then_some(
            "its pictures are sent unencrypted: others in the network can see them; `https://` \
             would encrypt them",
        )
    }

    /// Reads the login; `None` if the config has none. The password is the text of its file,
    /// without the end of the line.
    pub(crate) fn read_login(&self) -> Result<Option<CameraLogin>, LinkError> {
        let login = self.login.as_ref();
        login.map(|(user, file)| read_login(user, file.as_deref())).transpose()
    }
}

/// Reads the password of a user from its file; without a file, it is empty.
pub(crate) fn read_login(user: &str, file: Option<&Path>) -> Result<CameraLogin, LinkError> {
    let password = file.map(read).transpose()?.unwrap_or_default();
    let password = String::from_utf8(password)
        .map_err(|_| LinkError::File("log in: its password is no text".to_owned()))?;
    let password = password.trim_end_matches(['\n', '\r']).to_owned();
    Ok(CameraLogin { user: user.to_owned(), password })
}

impl Display for CameraAccess {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        Display::fmt(&self.address, f)
    }
}

/// Returns a text for an error about a rejected login: what a person has to check.
pub(crate) fn login_hint(access: &CameraAccess) -> String {
    match &access.login {
        None => "it wants a login; write `user` and `password-file`".to_owned(),
        Some((user, None)) => {
            format!("it rejects `{user}` without a password; write `password-file`")
        }
        Some((user, Some(file))) => {
            format!(
                "it rejects the user `{user}`, or the password in {}; ONVIF users are often a list \
                 of their own in the camera's settings",
                file.display()
            )
        }
    }
}

/// A login at a camera.
#[derive(Clone, PartialEq, Eq)]
pub(crate) struct CameraLogin {
    pub(crate) user: String,
    pub(crate) password: String,
}

impl Debug for CameraLogin {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.debug_struct("CameraLogin").field("user", &self.user).finish_non_exhaustive()
    }
}

pub(crate) fn read(file: &Path) -> Result<Vec<u8>, LinkError> {
    let said = |problem: String| LinkError::File(format!("read {}: {problem}", file.display()));
    let opened = std::fs::File::open(file).map_err(|error| said(error.to_string()))?;
    let mut bytes = Vec::new();
    let count = opened.take(FILE_BYTES_MAX + 1).read_to_end(&mut bytes);
    if count.map_err(|error| said(error.to_string()))? as u64 > FILE_BYTES_MAX {
        return Err(said(format!("it is longer than {FILE_BYTES_MAX} bytes")));
    }
    Ok(bytes)
}

fn fingerprint_of(text: &str) -> Option<[u8; FINGERPRINT_BYTES]> {
    let digits: Vec<_> = text.chars().filter(|symbol| *symbol != ':').collect();
    if digits.len() != 2 * FINGERPRINT_BYTES {
        return None;
    }
    let mut fingerprint = [0; FINGERPRINT_BYTES];
    for (byte, pair) in fingerprint.iter_mut().zip(digits.chunks_exact(2)) {
        let [high, low] = *pair else { return None };
        *byte = u8::try_from(high.to_digit(16)? * 16 + low.to_digit(16)?).ok()?;
    }
    Some(fingerprint)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path() -> Option<PathBuf> {
        Some(PathBuf::from("/x"))
    }

    #[test]
    fn an_incomplete_access_is_refused_with_a_correction() {
        let (user, nothing) = (|| Some("me".to_owned()), None);
        for (access, expected) in [
            (CameraAccess::new("cam", None, path(), None, nothing), "needs its `user`"),
            (
                CameraAccess::new("cam", user(), Some("x".into()), None, nothing),
                "`password-file` needs an absolute path",
            ),
            (CameraAccess::new("cam", None, None, path(), nothing), "are for TLS"),
            (CameraAccess::new("https://cam", None, None, None, nothing), "name the certificate"),
            (CameraAccess::new("https://cam", None, None, None, Some("ab")), "64 hexadecimal"),
            (
                CameraAccess::new("https://cam", None, None, path(), Some("ab")),
                "`ca` or `fingerprint`",
            ),
            (CameraAccess::new("cam", Some("a\"b".to_owned()), None, None, None), "quotation mark"),
        ] {
            let problem = access.expect_err(expected);
            assert!(problem.contains(expected), "{problem}");
        }
        let digits = "AB:".repeat(31) + "cd";
        let access = CameraAccess::new("https://cam", user(), path(), None, Some(&digits));
        assert!(access.is_ok_and(|access| access.risk().is_none()));
    }

    #[test]
    fn a_password_is_read_from_its_file_and_never_printed() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("password");
        std::fs::write(&file, "hunter2\n").expect("a file");
        let access = CameraAccess::new("cam", Some("me".to_owned()), Some(file), None, None);
        let access = access.expect("it is right");
        let login = access.read_login().expect("the file is there").expect("a login");
        assert_eq!(login.password, "hunter2");
        assert!(!format!("{access:?} {login:?}").contains("hunter2"));
        std::fs::write(folder.path().join("password"), vec![b'x'; 2 << 20]).expect("a file");
        let problem = access.read_login().expect_err("it is too long").to_string();
        assert!(problem.contains("it is longer than"), "{problem}");
    }
}
