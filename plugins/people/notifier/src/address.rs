//! Addresses of receivers: `https://…`, or `http://…` on this machine.

use std::fmt;
use std::net::{IpAddr, Ipv6Addr};

use hyper::http::uri::Authority;

const HTTP_PORT: u16 = 80;
const HTTPS_PORT: u16 = 443;

/// The address of a receiver. Its path may be a secret: it is in no log and no `Debug` output.
#[derive(Clone, PartialEq, Eq)]
pub(crate) struct ReceiverAddress {
    pub(crate) is_encrypted: bool,
    /// Host name or address, without brackets.
    pub(crate) host: String,
    pub(crate) port: u16,
    /// Path and query; begins with `/`.
    pub(crate) path: String,
}

// === impl ReceiverAddress ===

impl ReceiverAddress {
    /// Parses an address. Plain `http://` is for receivers on this machine only.
    ///
    /// # Errors
    ///
    /// Returns the reason as a text for a person, which does not repeat the address.
    pub(crate) fn parse(text: &str) -> Result<ReceiverAddress, &'static str> {
        let (is_encrypted, rest) =
            match (text.strip_prefix("https://"), text.strip_prefix("http://")) {
                (Some(rest), _) => (true, rest),
                (None, Some(rest)) => (false, rest),
                (None, None) => return Err("it begins neither with https:// nor with http://"),
            };
        if !text.bytes().all(|byte| byte.is_ascii_graphic()) {
            return Err("it has a space or a character beyond ASCII");
        }
        let (authority, path) = match rest.find(['/', '?']) {
            Some(at) => rest.split_at(at),
            None => (rest, ""),
        };
        if authority.contains('@') {
            return Err("a password in the ecosystem file would be read by everyone");
        }
        if path.contains('#') {
            return Err("a part after `#` is never sent");
        }
        let usual = if is_encrypted { HTTPS_PORT } else { HTTP_PORT };
        let (host, port) = host_and_port(authority, usual).ok_or("its host or port is wrong")?;
        if !is_encrypted && !is_loopback(&host) {
            return Err("plain http:// is for this machine only, because everyone on the network \
                        could read it; use https://, with `ca` if the certificate is your own");
        }
        let path = if path.starts_with('/') { path.to_owned() } else { format!("/{path}") };
        Ok(ReceiverAddress { is_encrypted, host, port, path })
    }

    /// Returns the host and the port, as the header `Host` has them.
    pub(crate) fn authority(&self) -> String {
        let host = match self.host.contains(':') {
            true => format!("[{}]", self.host),
            false => self.host.clone(),
        };
        let usual = if self.is_encrypted { HTTPS_PORT } else { HTTP_PORT };
        if self.port == usual { host } else { format!("{host}:{}", self.port) }
    }

    /// Returns the scheme, the host and the port: the origin of the address.
    pub(crate) fn origin(&self) -> String {
        let scheme = if self.is_encrypted { "https" } else { "http" };
        format!("{scheme}://{}", self.authority())
    }
}

impl fmt::Debug for ReceiverAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/…", self.origin())
    }
}

/// Whether a host is this machine.
pub(crate) fn is_loopback(host: &str) -> bool {
    host == "localhost" || host.parse().is_ok_and(|ip: IpAddr| ip.is_loopback())
}

/// Splits `host:port`, `[::1]:port` or a host alone. The host has no brackets.
pub(crate) fn host_and_port(authority: &str, usual: u16) -> Option<(String, u16)> {
    let parsed: Authority = authority.parse().ok()?;
    let port = match authority.strip_prefix(parsed.host())? {
        "" => usual,
        rest => rest.strip_prefix(':')?.parse().ok().filter(|port| *port != 0)?,
    };
    let host = match parsed.host().strip_prefix('[') {
        Some(rest) => rest.strip_suffix(']').filter(|host| host.parse::<Ipv6Addr>().is_ok())?,
        None => parsed.host(),
    };
    (!host.is_empty()).then(|| (host.to_owned(), port))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_parsed() {
        for (text, origin, path) in [
            ("https://ntfy.example/hall", "https://ntfy.example", "/hall"),
            ("https://ntfy.example:443", "https://ntfy.example", "/"),
            ("http://[::1]:8080/a?b=c", "http://[::1]:8080", "/a?b=c"),
            ("http://localhost?b", "http://localhost", "/?b"),
        ] {
            let address = ReceiverAddress::parse(text).expect(text);
            assert_eq!((address.origin().as_str(), address.path.as_str()), (origin, path));
        }
    }

    #[test]
    fn wrong_and_unsafe_addresses_are_refused_without_repeating_them() {
        for (text, why) in [
            ("ntfy.example/secret", "begins neither"),
            ("http://10.0.0.9/secret", "this machine only"),
            ("http://localhost.example/secret", "this machine only"),
            ("https://ann:secret@host/", "password"),
            ("https://host:0/secret", "host or port"),
            ("https:///secret", "host or port"),
            ("https://host:99999/secret", "host or port"),
            ("https://[::1]x/secret", "host or port"),
            ("https://host/secret here", "space"),
            ("https://host/a#secret", "`#`"),
        ] {
            let refused = ReceiverAddress::parse(text).expect_err(text);
            assert!(refused.contains(why) && !refused.contains("secret"), "{text}: {refused}");
        }
    }

    #[test]
    fn a_path_is_not_printed() {
        let address = ReceiverAddress::parse("https://host/secret").expect("an address");
        assert_eq!(format!("{address:?}"), "https://host/…");
    }
}
