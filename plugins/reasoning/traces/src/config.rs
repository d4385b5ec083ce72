//! The `config` of the entry: the collector, and how it is reached.

use std::net::{IpAddr, Ipv6Addr};
use std::path::PathBuf;

use agent::{Blueprint, BuildError};
use hyper::http::uri::Authority;
use serde::Deserialize;

/// Collector if the entry names none: the port of OTLP over HTTP on this machine.
const ENDPOINT: &str = "http://127.0.0.1:4318";

/// Path at which collectors take traces.
const TRACES_PATH: &str = "/v1/traces";

const HTTP_PORT: u16 = 80;
const HTTPS_PORT: u16 = 443;

/// The `config` of the entry of `traces` in the ecosystem file.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct TracesConfig {
    /// Address of the collector, such as `"http://127.0.0.1:4318"`.
    endpoint: Option<String>,
    /// File with the certificates of the authorities that may sign the collector's certificate.
    ca: Option<PathBuf>,
}

/// A collector of traces.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Collector {
    /// Host name or address, without brackets.
    pub(crate) host: String,
    pub(crate) port: u16,
    /// Path and query of the requests.
    pub(crate) path: String,
    /// File with the authorities of an encrypted connection; `None` for plain HTTP.
    pub(crate) ca: Option<PathBuf>,
}

/// Reads the `config` of the entry.
pub(crate) fn collector(blueprint: &Blueprint) -> Result<Collector, BuildError> {
    let TracesConfig { endpoint, ca } = blueprint.config_as()?;
    let endpoint = endpoint.as_deref().unwrap_or(ENDPOINT);
    let folder = blueprint.host.resources.get::<agent::EcosystemFolder>();
    // A relative path begins at the folder of the ecosystem file.
    let ca = ca.map(|path| folder.map_or(path.clone(), |folder| folder.0.join(&path)));
    Collector::parse(endpoint, ca).map_err(|problem| blueprint.problem(problem))
}

impl Collector {
    /// Parses the address of a collector. As for other exporters of OpenTelemetry, `/v1/traces` is
    /// appended to it unless it ends so.
    fn parse(endpoint: &str, ca: Option<PathBuf>) -> Result<Collector, String> {
        let wrong = |why: &str| {
            format!("`endpoint = \"{endpoint}\"`: {why}; write an address such as \"{ENDPOINT}\"")
        };
        let (is_encrypted, rest) =
            match (endpoint.strip_prefix("http://"), endpoint.strip_prefix("https://")) {
                (Some(rest), _) => (false, rest),
                (None, Some(rest)) => (true, rest),
                (None, None) => {
                    return Err(wrong("it begins neither with http:// nor with https://"));
                }
            };
        if !endpoint.bytes().all(|byte| byte.is_ascii_graphic()) {
            return Err(wrong("it has a space or a character beyond ASCII"));
        }
        let (authority, path) = match rest.find('/') {
            Some(at) => rest.split_at(at),
            None => (rest, ""),
        };
        if authority.contains('@') {
            return Err(wrong("a password in the ecosystem file would be read by everyone"));
        }
        let usual = if is_encrypted { HTTPS_PORT } else { HTTP_PORT };
        let (host, port) =
            host_and_port(authority, usual).ok_or_else(|| wrong("its host or port is wrong"))?;
        let is_loopback =
            host == "localhost" || host.parse().is_ok_and(|ip: IpAddr| ip.is_loopback());
        match (is_encrypted, ca) {
            (false, Some(_)) => Err(wrong("`ca` is for https://, and this is http://")),
            (false, None) if !is_loopback => Err(wrong(
                "plain http:// is for a collector on this machine only, because goals and names \
                 could be read on the network; use https:// with `ca`, or a collector here that \
                 passes traces on",
            )),
            (true, None) => Err(wrong(
                "https:// needs `ca`, the file with the authorities to trust, such as \
                 \"/etc/ssl/certs/ca-certificates.crt\"",
            )),
            (_, ca) => Ok(Collector { host, port, path: traces_path(path), ca }),
        }
    }

    /// Returns the host and the port, as the header `Host` has them.
    pub(crate) fn authority(&self) -> String {
        let Collector { host, port, .. } = self;
        if host.contains(':') { format!("[{host}]:{port}") } else { format!("{host}:{port}") }
    }
}

fn traces_path(path: &str) -> String {
    let base = path.trim_end_matches('/');
    match base.ends_with(TRACES_PATH) {
        true => base.to_owned(),
        false => format!("{base}{TRACES_PATH}"),
    }
}

/// Splits `host:port`, `[::1]:port` or a host alone. The host has no brackets.
fn host_and_port(authority: &str, usual: u16) -> Option<(String, u16)> {
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
    fn addresses_are_completed() {
        let of = |endpoint: &str| {
            let collector = Collector::parse(endpoint, None).expect(endpoint);
            (collector.authority(), collector.path)
        };
        let told = |authority: &str, path: &str| (authority.to_owned(), path.to_owned());
        assert_eq!(of(ENDPOINT), told("127.0.0.1:4318", "/v1/traces"));
        assert_eq!(of("http://localhost"), told("localhost:80", "/v1/traces"));
        assert_eq!(of("http://[::1]:9/otlp/"), told("[::1]:9", "/otlp/v1/traces"));
        assert_eq!(of("http://127.0.0.1:9/v1/traces"), told("127.0.0.1:9", "/v1/traces"));
        let ca = Some(PathBuf::from("/ca.pem"));
        let secured = Collector::parse("https://otel.example", ca).expect("an address");
        assert_eq!(secured.authority(), "otel.example:443");
    }

    #[test]
    fn addresses_that_are_wrong_or_unsafe_are_refused() {
        for (endpoint, ca, why) in [
            ("127.0.0.1:4318", None, "begins neither"),
            ("http://10.0.0.9:4318", None, "on this machine only"),
            ("http://localhost.example:4318", None, "on this machine only"),
            ("https://otel.example", None, "needs `ca`"),
            ("http://localhost", Some("/ca.pem"), "`ca` is for https://"),
            ("http://ann:secret@localhost", None, "password"),
            ("http://localhost:0", None, "host or port"),
            ("http://:4318", None, "host or port"),
            ("http://[zz]:1", None, "host or port"),
            ("http://[::1]x", None, "host or port"),
            ("http://localhost:99999", None, "host or port"),
            ("http://local host", None, "space"),
        ] {
            let refused = Collector::parse(endpoint, ca.map(PathBuf::from)).expect_err(endpoint);
            assert!(refused.contains(why), "{endpoint}: {refused}");
        }
    }
}
