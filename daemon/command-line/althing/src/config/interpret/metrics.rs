//! The address at which daemons serve metrics.

use std::net::{IpAddr, SocketAddr};

use pddl::Diagnostic;

use super::Interpreter;
use crate::config::raw::RawMetrics;

/// The port of the examples, which no other program has by custom: that of OpenTelemetry's exporters
/// for Prometheus.
const PORT: u16 = 9464;

/// The address of the examples.
const EXAMPLE: &str = "127.0.0.1:9464";

// === impl Interpreter ===

impl Interpreter<'_> {
    /// Returns the address at which daemons serve metrics; `None` if the file does not ask for it.
    /// Reports an address that other machines reach although the ecosystem is not secured.
    pub(super) fn metrics(&mut self, raw: RawMetrics) -> Option<SocketAddr> {
        let RawMetrics { listen } = raw;
        let is_secured = self.is_in_file("security");
        let Some(listen) = listen else {
            if self.place("metrics").is_some() {
                self.missing("metrics", "listen", EXAMPLE);
            }
            return None;
        };
        let (message, help) = match listen.parse::<SocketAddr>() {
            Ok(address) if address.ip().is_loopback() || is_secured => return Some(address),
            Ok(address) => (
                format!("`{}` is not an address of this machine alone", address.ip()),
                format!(
                    "write \"127.0.0.1:{}\"; an ecosystem with [security] may listen elsewhere, \
                     and answers only who has a certificate",
                    address.port()
                ),
            ),
            Err(_) => (
                format!("`{listen}` is not an address with a port"),
                format!("write \"{}\"", corrected_address(&listen, PORT)),
            ),
        };
        self.about_value("metrics.listen", |span| Diagnostic::error(span, message).with_help(help));
        None
    }
}

/// Returns the address that `written` probably means; `usual` is the port if it names none.
pub(super) fn corrected_address(written: &str, usual: u16) -> String {
    let local = |port: &str| port.parse::<u16>().ok().map(|port| format!("127.0.0.1:{port}"));
    let (host, port) = written.rsplit_once(':').unwrap_or(("", written));
    let named = host.is_empty() || host == "localhost" || host == "*";
    let address = written.trim_matches(['[', ']']).parse::<IpAddr>().ok();
    let address = address.map(|ip| SocketAddr::new(ip, usual).to_string());
    let corrected = address.or_else(|| local(port).filter(|_| named));
    corrected.unwrap_or_else(|| format!("127.0.0.1:{usual}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_with_a_part_missing_is_completed() {
        for (written, expected) in [
            ("9464", "127.0.0.1:9464"),
            (":80", "127.0.0.1:80"),
            ("localhost:9000", "127.0.0.1:9000"),
            ("127.0.0.1", "127.0.0.1:9464"),
            ("::1", "[::1]:9464"),
            ("office-pi:9464", "127.0.0.1:9464"),
            ("0:99999", "127.0.0.1:9464"),
            ("", "127.0.0.1:9464"),
        ] {
            assert_eq!(corrected_address(written, PORT), expected, "{written}");
        }
    }
}
