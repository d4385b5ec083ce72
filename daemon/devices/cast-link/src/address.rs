//! The address of a Chromecast, as a config writes it.

use std::fmt;
use std::net::{IpAddr, Ipv6Addr};

/// Port at which a Chromecast listens. Groups of speakers have other ports.
const PORT: u16 = 8009;

/// Maximum length of a host's name, as DNS has it, in bytes.
const HOST_BYTES_MAX: usize = 253;

/// The address of a Chromecast.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct CastAddress {
    /// Name or IP address of the host; an IPv6 address has no brackets.
    pub(crate) host: String,
    pub(crate) port: u16,
}

impl CastAddress {
    /// Reads `HOST` or `HOST:PORT`. An IPv6 address with a port needs brackets.
    ///
    /// # Errors
    ///
    /// Returns the reason why the text is no address, and what would be one.
    pub fn parse(text: &str) -> Result<CastAddress, String> {
        let wrong = |why: &str| {
            format!("the address `{text}` {why}; write HOST or HOST:PORT, such as \"10.0.0.7\"")
        };
        if text.contains("//") {
            return Err(wrong("is a URL"));
        }
        let (host, port) = if text.parse::<Ipv6Addr>().is_ok() {
            (text, None)
        } else if let Some((host, rest)) = text.strip_prefix('[').and_then(|t| t.split_once(']')) {
            if host.parse::<Ipv6Addr>().is_err() {
                return Err(wrong("has no IPv6 address in its brackets"));
            }
            let port = rest.strip_prefix(':');
            if port.is_none() && !rest.is_empty() {
                return Err(wrong("has something else than a port behind its brackets"));
            }
            (host, port)
        } else {
            match text.split_once(':') {
                Some((host, port)) => (host, Some(port)),
                None => (text, None),
            }
        };
        let port = match port.map(str::parse) {
            None => PORT,
            Some(Ok(port)) if port > 0 => port,
            Some(_) => return Err(wrong("has no port from 1 to 65535 behind its colon")),
        };
        let is_letter = |symbol: char| symbol.is_ascii_alphanumeric() || "-._".contains(symbol);
        let is_host = host.parse::<IpAddr>().is_ok()
            || !host.is_empty() && host.len() <= HOST_BYTES_MAX && host.chars().all(is_letter);
        if !is_host {
            return Err(wrong("names no host"));
        }
        Ok(CastAddress { host: host.to_owned(), port })
    }

    /// Returns the address of a device that was found; without a port, at the usual one.
    pub(crate) fn of(ip: IpAddr, port: Option<u16>) -> CastAddress {
        CastAddress { host: ip.to_string(), port: port.unwrap_or(PORT) }
    }
}

impl fmt::Display for CastAddress {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let CastAddress { host, port } = self;
        match (host.contains(':'), *port == PORT) {
            (_, true) => write!(formatter, "{host}"),
            (true, false) => write!(formatter, "[{host}]:{port}"),
            (false, false) => write!(formatter, "{host}:{port}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_a_host_with_or_without_a_port() {
        for (text, host, port, again) in [
            ("10.0.0.7", "10.0.0.7", 8009, "10.0.0.7"),
            ("10.0.0.7:32187", "10.0.0.7", 32_187, "10.0.0.7:32187"),
            ("tv.local:8009", "tv.local", 8009, "tv.local"),
            ("fe80::1", "fe80::1", 8009, "fe80::1"),
            ("[fe80::1]:9", "fe80::1", 9, "[fe80::1]:9"),
        ] {
            let address = CastAddress::parse(text).expect(text);
            assert_eq!((address.host.as_str(), address.port), (host, port));
            assert_eq!(address.to_string(), again);
        }
    }

    #[test]
    fn what_is_no_address_is_refused_with_the_reason() {
        for (text, why) in [
            ("", "names no host"),
            ("https://10.0.0.7", "is a URL"),
            ("10.0.0.7:", "no port"),
            ("10.0.0.7:0", "no port"),
            ("10.0.0.7:99999", "no port"),
            ("a b", "names no host"),
            ("[x]:1", "no IPv6 address"),
            ("[::1]1", "something else than a port"),
            (&"a".repeat(300), "names no host"),
        ] {
            let problem = CastAddress::parse(text).expect_err(text);
            assert!(problem.contains(why) && problem.contains("HOST:PORT"), "{problem}");
        }
    }
}
