//! HTTP requests to a program beside a camera, such as Motion: with the login, the limits and the
//! errors of the requests to a camera.

use std::time::Duration;

use hyper::body::Bytes;

use crate::access::CameraAccess;
use crate::address::Address;
use crate::camera::{CameraPicture, picture_of};
use crate::error::LinkError;
use crate::session::{CameraSession, random};

/// Maximum length of a text, in bytes.
const TEXT_BYTES_MAX: usize = 64 << 10;

/// Time limit for a text, of a server that is busy with its pictures.
const TEXT_TIME_MAX: Duration = Duration::from_secs(5);

/// A server of pictures and texts that does not speak ONVIF.
#[derive(Debug)]
pub struct PictureServer {
    session: CameraSession,
}

impl PictureServer {
    /// Reads the login from its file. Connects to nothing.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be read.
    pub fn new(access: &CameraAccess) -> Result<PictureServer, LinkError> {
        Ok(PictureServer { session: CameraSession::without_clock(access)? })
    }

    /// Gets a picture.
    ///
    /// # Errors
    ///
    /// Returns an error if the server does not answer, or answers anything else than a picture.
    pub async fn picture(&self, path: &str) -> Result<CameraPicture, LinkError> {
        picture_of(&self.session, &self.at(path)).await
    }

    /// Gets a text.
    ///
    /// # Errors
    ///
    /// Returns an error if the server does not answer, or the text is longer than 64 KiB.
    pub async fn text(&self, path: &str) -> Result<String, LinkError> {
        let call = format!("the request for {path}");
        let (at, limit) = (self.at(path), TEXT_TIME_MAX);
        let answer = self.session.get(&at, &call, TEXT_BYTES_MAX, limit).await;
        let (_, text): (String, Bytes) = answer?;
        Ok(String::from_utf8_lossy(&text).into_owned())
    }

    fn at(&self, path: &str) -> Address {
        Address { path: path.to_owned(), ..self.session.address().clone() }
    }
}

/// Returns a new random password.
///
/// # Errors
///
/// Returns an error if this machine has no random numbers.
pub fn new_password() -> Result<String, LinkError> {
    random().map(|bytes| crate::digest::hex(&bytes))
}
