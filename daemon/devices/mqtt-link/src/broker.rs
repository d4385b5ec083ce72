//! Address of an MQTT broker, and the login for the broker.

use std::fmt::{self, Display, Formatter};
use std::net::IpAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rumqttc::{MqttOptions, Transport};
use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject as _;
use rustls::{ClientConfig, RootCertStore};

/// Broker that is used if the config names none.
const BROKER: &str = "localhost:1883";

/// Ports of a broker without and with TLS (IANA registry).
const PORT: u16 = 1883;
const TLS_PORT: u16 = 8883;

/// Maximum size of a file with a password or certificates, in bytes; a longer file is an error.
const FILE_BYTES_MAX: usize = 1 << 20;

/// Address of an MQTT broker, and the files with its credentials. The password is read from its
/// file at each attempt to connect, and is never stored in this value.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Broker {
    host: String,
    port: u16,
    user: Option<(String, Option<PathBuf>)>,
    /// File with the certificates of the authorities that are trusted to sign the broker's
    /// certificate; `None` for a connection without TLS.
    ca: Option<PathBuf>,
}

impl Broker {
    /// Returns the broker for an entry in a config. `name` has the form `HOST`, `HOST:PORT`,
    /// `mqtt://…` or `mqtts://…`; `None` stands for `localhost:1883`. `user` and `password_file`
    /// are the login at the broker. `ca` is the file with the certificates of the trusted
    /// authorities (PEM).
    ///
    /// # Errors
    ///
    /// Returns an error with the mistake in the entry and its correction.
    pub fn new(
        name: Option<&str>,
        user: Option<String>,
        password_file: Option<PathBuf>,
        ca: Option<PathBuf>,
    ) -> Result<Broker, String> {
        let name = name.unwrap_or(BROKER);
        let wrong = |problem: &str| Err(format!("broker `{}`: {problem}", without_secret(name)));
        let (is_encrypted, rest) = match without_scheme(name) {
            Ok(parts) => parts,
            Err(problem) => return wrong(&problem),
        };
        if rest.contains('@') {
            return wrong("write `user` and `password-file` beside it: this file is no secret");
        }
        let rest = rest.trim_end_matches('/');
        // An IPv6 address contains colons; it is in brackets if a port follows.
        let is_bare_ip = rest.parse::<IpAddr>().is_ok();
        let parts = rest.rsplit_once(':').filter(|(host, port)| {
            !is_bare_ip && !port.ends_with(']') && (!host.contains(':') || host.ends_with(']'))
        });
        let (host, port) = match parts {
            Some((host, port)) => (host, port.parse().ok()),
            None => (rest, Some(if is_encrypted { TLS_PORT } else { PORT })),
        };
        let Some(port) = port.filter(|port| *port != 0) else {
            return wrong("its port is no number from 1 to 65535; write HOST:PORT");
        };
        let host = host.trim_start_matches('[').trim_end_matches(']');
        if host.is_empty() {
            return wrong("it has no host; write HOST:PORT");
        }
        if !is_host(host) {
            return wrong("its host is neither a name nor an address; write HOST:PORT");
        }
        if is_encrypted != ca.is_some() {
            return wrong(match is_encrypted {
                true => {
                    "name the certificate authorities to trust: \
                     ca = \"/etc/ssl/certs/ca-certificates.crt\", or your own"
                }
                false => "`ca` is for TLS; write mqtts://HOST:PORT",
            });
        }
        for (key, file) in [("password-file", &password_file), ("ca", &ca)] {
            if file.as_ref().is_some_and(|file| file.is_relative()) {
                return wrong(&format!("`{key}` needs an absolute path"));
            }
        }
        let user = match (user, password_file) {
            (Some(user), password_file) => Some((user, password_file)),
            (None, Some(_)) => return wrong("a `password-file` needs its `user`"),
            (None, None) => None,
        };
        Ok(Broker { host: host.to_owned(), port, user, ca })
    }

    pub(crate) fn host(&self) -> &str {
        &self.host
    }

    pub(crate) fn port(&self) -> u16 {
        self.port
    }

    /// Returns a warning for a person if the connection to the broker is not protected. Returns
    /// `None` if it is protected, or stays on this machine.
    pub(crate) fn risk(&self) -> Option<&'static str> {
        let is_here =
            self.host == "localhost" || self.host.parse().is_ok_and(|ip: IpAddr| ip.is_loopback());
        match (&self.ca, &self.user) {
            (None, Some(_)) if !is_here => {
                Some("the password is sent as plain text; `mqtts://` would encrypt it")
            }
            (None, None) if !is_here => Some(
                "messages from the broker are plain text: others in the network can read and \
                 change them",
            ),
            _ => None,
        }
    }

    /// Reads the password and the trusted authorities from their files into `options`. The text of
    /// an error completes “failed to …”.
    pub(crate) fn prepare(&self, options: &mut MqttOptions) -> Result<(), String> {
        if let Some((user, file)) = &self.user {
            let password = file.as_deref().map(read).transpose()?.unwrap_or_default();
            let password = String::from_utf8(password);
            let password = password.map_err(|_| "log in: its password is no text".to_owned())?;
            options.set_credentials(user, password.trim_end_matches(['\n', '\r']));
        }
        if let Some(file) = &self.ca {
            options.set_transport(Transport::tls_with_config(trust(file)?.into()));
        }
        Ok(())
    }
}

impl Display for Broker {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Broker { host, port, .. } = self;
        if host.contains(':') { write!(f, "[{host}]:{port}") } else { write!(f, "{host}:{port}") }
    }
}

/// Returns the TLS settings that trust the authorities in a file of certificates.
fn trust(file: &Path) -> Result<ClientConfig, String> {
    let said = |problem: &dyn Display| format!("use {}: {problem}", file.display());
    let mut authorities = RootCertStore::empty();
    let found = CertificateDer::pem_slice_iter(&read(file)?).collect::<Result<Vec<_>, _>>();
    authorities.add_parsable_certificates(found.map_err(|error| said(&error))?);
    if authorities.is_empty() {
        return Err(said(&"there is no certificate in it"));
    }
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config =
        ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions();
    let config = config.map_err(|error| said(&error))?;
    Ok(config.with_root_certificates(authorities).with_no_client_auth())
}

fn read(file: &Path) -> Result<Vec<u8>, String> {
    let said = |problem: String| format!("read {}: {problem}", file.display());
    let bytes = std::fs::read(file).map_err(|error| said(error.to_string()))?;
    if bytes.len() > FILE_BYTES_MAX {
        return Err(said(format!("it is longer than {FILE_BYTES_MAX} bytes")));
    }
    Ok(bytes)
}

/// Returns the name of a broker without the user and password that it may contain.
fn without_secret(name: &str) -> String {
    match (name.split_once("://"), name.rsplit_once('@')) {
        (Some((scheme, _)), Some((_, host))) => format!("{scheme}://…@{host}"),
        (None, Some((_, host))) => format!("…@{host}"),
        _ => name.to_owned(),
    }
}

/// Returns whether the connection is encrypted, by the scheme of a broker's name, and the rest.
fn without_scheme(name: &str) -> Result<(bool, &str), String> {
    match name.split_once("://") {
        None => Ok((false, name)),
        // Other programs write `tcp`, `ssl` and `tls` for the same.
        Some(("mqtt" | "tcp", rest)) => Ok((false, rest)),
        Some(("mqtts" | "ssl" | "tls", rest)) => Ok((true, rest)),
        Some(("ws" | "wss", _)) => {
            Err("websockets are not built; write HOST:PORT or mqtts://HOST:PORT".to_owned())
        }
        Some((scheme, _)) => {
            Err(format!("`{scheme}` is not MQTT; write HOST:PORT or mqtts://HOST:PORT"))
        }
    }
}

/// Whether a text is an IP address, or a name that a host may have.
fn is_host(text: &str) -> bool {
    let text = text.strip_suffix('.').unwrap_or(text);
    let is_label = |label: &str| {
        let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-_".contains(&byte);
        !label.is_empty() && label.bytes().all(is_plain)
    };
    // `192.168.1.300` is a mistyped address: the last label of a host name is no number.
    let ends_in_number =
        text.rsplit('.').next().is_some_and(|last| last.bytes().all(|byte| byte.is_ascii_digit()));
    text.parse::<IpAddr>().is_ok() || !ends_in_number && text.split('.').all(is_label)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(name: &str) -> Result<String, String> {
        let ca = name.starts_with("mqtts").then(|| PathBuf::from("/ca.pem"));
        Broker::new(Some(name), None, None, ca).map(|broker| broker.to_string())
    }

    #[test]
    fn every_form_of_a_broker_name_is_parsed() {
        for (name, expected) in [
            ("broker.local", "broker.local:1883"),
            ("broker.local:1884", "broker.local:1884"),
            ("mqtt://10.0.0.2", "10.0.0.2:1883"),
            ("tcp://localhost:1884", "localhost:1884"),
            ("zigbee_1.lan.", "zigbee_1.lan.:1883"),
            ("mqtts://broker.local/", "broker.local:8883"),
            ("mqtts://broker.local:9000", "broker.local:9000"),
            ("::1", "[::1]:1883"),
            ("[::1]:1884", "[::1]:1884"),
            ("[::1]", "[::1]:1883"),
        ] {
            assert_eq!(named(name).as_deref(), Ok(expected), "{name}");
        }
        for (name, expected) in [
            ("x:port", "its port is no number"),
            ("x:0", "its port is no number"),
            (":1883", "it has no host"),
            ("ws://x", "websockets are not built"),
            ("http://x", "`http` is not MQTT"),
            ("lokal host", "neither a name nor an address"),
            ("192.168.1.300", "neither a name nor an address"),
            ("broker..local", "neither a name nor an address"),
        ] {
            assert!(named(name).is_err_and(|problem| problem.contains(expected)), "{name}");
        }
    }

    #[test]
    fn a_password_in_a_name_is_never_printed() {
        let problem = named("mqtt://me:hunter2@broker.local").expect_err("it belongs elsewhere");
        assert!(!problem.contains("hunter2"), "{problem}");
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("password");
        std::fs::write(&file, "hunter2\n").expect("a file");
        let broker =
            Broker::new(None, Some("me".to_owned()), Some(file), None).expect("it is right");
        assert!(!format!("{broker} {broker:?}").contains("hunter2"));
        let mut options = MqttOptions::new("a", broker.host(), broker.port());
        broker.prepare(&mut options).expect("the file is there");
        let login = options.credentials().expect("they are set");
        assert_eq!((login.username.as_str(), login.password.as_str()), ("me", "hunter2"));
    }

    #[test]
    fn an_incomplete_login_is_refused_with_a_correction() {
        let path = || Some(PathBuf::from("/x"));
        let user = || Some("me".to_owned());
        for (broker, expected) in [
            (Broker::new(None, None, path(), None), "a `password-file` needs its `user`"),
            (Broker::new(None, user(), Some("x".into()), None), "needs an absolute path"),
            (Broker::new(Some("x"), None, None, path()), "`ca` is for TLS"),
            (Broker::new(Some("mqtts://x"), None, None, None), "name the certificate authorities"),
        ] {
            assert!(broker.is_err_and(|problem| problem.contains(expected)), "{expected}");
        }
    }
}
