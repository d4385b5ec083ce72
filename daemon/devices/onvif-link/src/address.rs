//! Addresses of cameras and of their services.

use std::fmt::{self, Display, Formatter};
use std::net::IpAddr;

/// Ports of a camera without and with TLS.
const PORT: u16 = 80;
const TLS_PORT: u16 = 443;

/// Path of the device service, which every ONVIF device has.
const DEVICE_PATH: &str = "/onvif/device_service";

/// Maximum length of an address, in bytes; a longer one is refused.
const ADDRESS_BYTES_MAX: usize = 1_024;

/// An address of a camera: that of its device service, or of one of its other services.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// Whether the connection is encrypted by TLS.
    pub is_encrypted: bool,
    /// Name or IP address of the camera, without brackets.
    pub host: String,
    /// Port of the service.
    pub port: u16,
    /// Path and query of the service, beginning with `/`.
    pub path: String,
}

impl Address {
    /// Returns the address for the text of a config: `HOST`, `HOST:PORT`, `http://…` or
    /// `https://…`. A text without a path gives the address of the device service.
    ///
    /// # Errors
    ///
    /// Returns an error with the mistake in the text and its correction.
    pub fn parse(text: &str) -> Result<Address, String> {
        let authority = text.split_once("://").map_or(text, |(_, rest)| rest);
        if authority.split('/').next().is_some_and(|authority| authority.contains('@')) {
            return Err("camera address: write `user` and `password-file` beside it: this file \
                        is no secret"
                .to_owned());
        }
        let wrong = |problem: &str| Err(format!("camera address `{text}`: {problem}"));
        if text.len() > ADDRESS_BYTES_MAX {
            return Err(format!("camera address: it is longer than {ADDRESS_BYTES_MAX} bytes"));
        }
        if text.chars().any(|symbol| symbol.is_control() || symbol.is_whitespace()) {
            return wrong("it has a space or a control character; write HOST or http://HOST:PORT");
        }
        let (is_encrypted, rest) = match text.split_once("://") {
            None => (false, text),
            Some(("http", rest)) => (false, rest),
            Some(("https", rest)) => (true, rest),
            Some(_) => return wrong("write HOST, http://HOST:PORT or https://HOST:PORT"),
        };
        let (authority, path) = match rest.find('/') {
            Some(start) => rest.split_at(start),
            None => (rest, ""),
        };
        let is_bare_ip = authority.parse::<IpAddr>().is_ok();
        let parts = authority.rsplit_once(':').filter(|(host, port)| {
            !is_bare_ip && !port.ends_with(']') && (!host.contains(':') || host.ends_with(']'))
        });
        let (host, port) = match parts {
            Some((host, port)) => (host, port.parse().ok()),
            None => (authority, Some(if is_encrypted { TLS_PORT } else { PORT })),
        };
        let Some(port) = port.filter(|port| *port != 0) else {
            return wrong("its port is no number from 1 to 65535; write HOST:PORT");
        };
        let host = host.trim_start_matches('[').trim_end_matches(']').to_owned();
        if host.is_empty() {
            return wrong("it has no host; write HOST:PORT");
        }
        let path = if path.len() > 1 { path.to_owned() } else { DEVICE_PATH.to_owned() };
        let is_ascii = path.bytes().all(|byte| byte.is_ascii_graphic());
        if !is_ascii || path.parse::<hyper::http::uri::PathAndQuery>().is_err() {
            return wrong("its path has a symbol that no path has");
        }
        Ok(Address { is_encrypted, host, port, path })
    }

    /// Returns the address of a service from the text `named` of the camera; `None` if the text is
    /// no address.
    ///
    /// The host is always that of this address, and TLS stays TLS: a camera behind a router names
    /// an address that is not reachable, and a hostile camera must not direct the login elsewhere.
    /// The port that the camera has named counts only together with the host of this address.
    pub(crate) fn resolve(&self, named: &str, peer: Option<IpAddr>) -> Option<Address> {
        let named = Address::parse(named.trim()).ok()?;
        let named_ip = named.host.parse().ok();
        let is_here =
            named.host.eq_ignore_ascii_case(&self.host) || (named_ip.is_some() && named_ip == peer);
        let keeps_port = is_here && named.is_encrypted == self.is_encrypted;
        let port = if keeps_port { named.port } else { self.port };
        Some(Address { path: named.path, port, ..self.clone() })
    }

    /// Returns the value of the HTTP header `Host`.
    pub(crate) fn authority(&self) -> String {
        let Address { host, port, .. } = self;
        let host = if host.contains(':') { format!("[{host}]") } else { host.clone() };
        let is_default = *port == if self.is_encrypted { TLS_PORT } else { PORT };
        if is_default { host } else { format!("{host}:{port}") }
    }

    /// Returns the shortest text from which [`Address::parse`] makes this address.
    pub(crate) fn text(&self) -> String {
        if self.path == DEVICE_PATH { self.to_string() } else { self.url() }
    }

    pub(crate) fn url(&self) -> String {
        let scheme = if self.is_encrypted { "https" } else { "http" };
        format!("{scheme}://{}{}", self.authority(), self.path)
    }
}

impl Display for Address {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let scheme = if self.is_encrypted { "https://" } else { "" };
        write!(f, "{scheme}{}", self.authority())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_of_an_address_is_parsed() {
        for (text, expected) in [
            ("10.0.0.9", "http://10.0.0.9/onvif/device_service"),
            ("10.0.0.9:8000", "http://10.0.0.9:8000/onvif/device_service"),
            ("http://cam/", "http://cam/onvif/device_service"),
            ("https://cam/onvif/x?y=1", "https://cam/onvif/x?y=1"),
            ("https://[::1]:4430", "https://[::1]:4430/onvif/device_service"),
            ("::1", "http://[::1]/onvif/device_service"),
        ] {
            let address = Address::parse(text).expect(text);
            assert_eq!(address.url(), expected);
            assert_eq!(Address::parse(&address.text()), Ok(address));
        }
        for (text, expected) in [
            ("rtsp://cam", "write HOST"),
            ("cam:0", "its port is no number"),
            ("", "it has no host"),
            ("cam 1", "a space"),
            ("http://cam/ä{", "no path"),
        ] {
            let problem = Address::parse(text).expect_err(text);
            assert!(problem.contains(expected), "{text}: {problem}");
        }
    }

    #[test]
    fn a_password_in_an_address_is_never_printed() {
        let problem = Address::parse("http://me:hunter2@cam").expect_err("it belongs elsewhere");
        assert!(!problem.contains("hunter2") && problem.contains("password-file"), "{problem}");
    }

    #[test]
    fn a_named_service_is_always_at_the_host_of_the_config() {
        let ours = Address::parse("https://cam:8443").expect("an address");
        let peer = "10.0.0.9".parse().ok();
        for (named, expected) in [
            ("https://cam:9443/ptz", "https://cam:9443/ptz"),
            ("https://10.0.0.9:9443/ptz", "https://cam:9443/ptz"),
            ("http://cam:80/ptz", "https://cam:8443/ptz"),
            ("https://evil.example/ptz", "https://cam:8443/ptz"),
        ] {
            let resolved = ours.resolve(named, peer).map(|address| address.url());
            assert_eq!(resolved.as_deref(), Some(expected));
        }
        assert_eq!(ours.resolve("not an address", peer), None);
    }
}
