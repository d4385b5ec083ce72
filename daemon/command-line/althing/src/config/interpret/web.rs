//! The page for browsers: its address, the daemons that serve it, and its certificate.

use std::collections::BTreeSet;
use std::net::{IpAddr, SocketAddr};
use std::path::Path;

use acl::DaemonId;
use pddl::Diagnostic;

use super::Interpreter;
use super::metrics::corrected_address;
use crate::config::ecosystem::{PageFiles, WebSettings};
use crate::config::raw::RawWeb;

/// The port of the examples, which no other program has by custom.
const PORT: u16 = 8650;

/// The address of the examples.
const EXAMPLE: &str = "127.0.0.1:8650";

/// Maximum length of a host name, by the rules of the domain name system.
const HOST_BYTES_MAX: usize = 253;

// === impl Interpreter ===

impl Interpreter<'_> {
    /// Returns the settings of the page; `None` if the file does not ask for one, or if its address
    /// is wrong.
    pub(super) fn web(&mut self, raw: RawWeb, daemons: &BTreeSet<DaemonId>) -> Option<WebSettings> {
        let RawWeb { listen, daemons: named, names, certificate, key } = raw;
        self.place("web")?;
        self.refuse_without_feature(&named);
        let serving = self.serving(&named, daemons);
        names.iter().for_each(|name| self.check_host(name));
        let beside = |file: String| self.file.parent().unwrap_or(Path::new("")).join(file);
        let files = match (certificate.map(beside), key.map(beside)) {
            (Some(certificate), Some(key)) => Some(PageFiles { certificate, key }),
            (None, None) => None,
            (Some(_), None) => {
                self.missing("web", "key", "page.key");
                None
            }
            (None, Some(_)) => {
                self.missing("web", "certificate", "page.pem");
                None
            }
        };
        let listen = self.page_address(listen)?;
        Some(WebSettings { listen, daemons: serving, names, files })
    }

    /// Returns the address of the page. Reports an address that other machines reach although the
    /// ecosystem is not secured.
    fn page_address(&mut self, listen: Option<String>) -> Option<SocketAddr> {
        let Some(listen) = listen else {
            self.missing("web", "listen", EXAMPLE);
            return None;
        };
        let is_secured = self.is_in_file("security");
        let (message, help) = match listen.parse::<SocketAddr>() {
            Ok(address) if address.ip().is_loopback() || is_secured => return Some(address),
            Ok(address) => (
                format!("`{}` is not an address of this machine alone", address.ip()),
                format!(
                    "write \"127.0.0.1:{}\"; an ecosystem with [security] may serve its page \
                     elsewhere, by TLS",
                    address.port()
                ),
            ),
            Err(_) => (
                format!("`{listen}` is not an address with a port"),
                format!("write \"{}\"", corrected_address(&listen, PORT)),
            ),
        };
        self.about_value("web.listen", |span| Diagnostic::error(span, message).with_help(help));
        None
    }

    /// Returns the daemons that serve the page, and reports unknown ones.
    fn serving(&mut self, named: &[String], known: &BTreeSet<DaemonId>) -> BTreeSet<DaemonId> {
        let mut serving = BTreeSet::new();
        for name in named {
            match DaemonId::new(name) {
                Ok(daemon) if known.is_empty() || known.contains(&daemon) => {
                    serving.insert(daemon);
                }
                Ok(daemon) => {
                    let near = pddl::nearest(name, known.iter().map(DaemonId::as_str));
                    let help = match near {
                        Some(near) => format!("did you mean `{near}`?"),
                        None => "list it in `daemons` of [ecosystem]".to_owned(),
                    };
                    let message = format!("the ecosystem has no daemon called `{daemon}`");
                    self.about_value("web.daemons", |span| {
                        Diagnostic::error(span, message).with_help(help)
                    });
                }
                Err(error) => self.invalid_name("web.daemons", &error),
            }
        }
        serving
    }

    fn check_host(&mut self, name: &str) {
        let is_label = |label: &str| {
            let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-';
            !label.is_empty() && label.bytes().all(is_plain)
        };
        let is_host = name.len() <= HOST_BYTES_MAX && name.split('.').all(is_label);
        if !is_host && name.parse::<IpAddr>().is_err() {
            let message = format!("`{name}` is not a host name");
            let help = "write it as browsers show it, without https:// and without a port";
            self.about_value("web.names", |span| Diagnostic::error(span, message).with_help(help));
        }
    }

    /// Reports that this program serves no page, if every daemon is to serve it.
    #[cfg(not(feature = "web"))]
    fn refuse_without_feature(&mut self, named: &[String]) {
        if named.is_empty() {
            let message = "this program was built without pages (feature `web`)";
            let help = "name the daemons that serve the page: daemons = [\"NAME\"], or use a \
                        program that was built with the feature";
            self.about_key("web", |span| Diagnostic::error(span, message).with_help(help));
        }
    }

    #[cfg(feature = "web")]
    #[allow(clippy::unused_self, reason = "without the feature it reports")]
    fn refuse_without_feature(&mut self, _named: &[String]) {}
}
