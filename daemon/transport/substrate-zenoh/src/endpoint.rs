//! Check of the endpoints on which a daemon may listen, and to which it may connect, before Zenoh
//! uses them.
//!
//! Links in plain text stay on the machine; links beyond it are TLS. Zenoh reports a bad endpoint
//! late and without its name, so errors that can be found early are reported here.

use std::net::IpAddr;

/// Reason why an endpoint is invalid.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum EndpointError {
    /// The endpoint does not have the form `protocol/address`.
    #[error("read endpoint `{0}`: write PROTOCOL/ADDRESS, like `tls/office-pi.local:7447`")]
    Malformed(String),
    /// The endpoint is written as a URL.
    #[error("read endpoint `{endpoint}`: write `{meant}`")]
    Url {
        /// The invalid endpoint.
        endpoint: String,
        /// The same endpoint in the form of Zenoh.
        meant: String,
    },
    /// The endpoint has a protocol that this build does not support.
    #[error("use endpoint `{endpoint}`: this build speaks {}, not `{protocol}`", PROTOCOLS.join(", "))]
    UnknownProtocol {
        /// The invalid endpoint.
        endpoint: String,
        /// The protocol of the endpoint.
        protocol: String,
    },
    /// The address of the endpoint is malformed, or its port is not allowed.
    #[error(
        "use endpoint `{endpoint}`: `{address}` is no address; write HOST:PORT, with a port from {first} to \
         65535, like `{protocol}/office-pi.local:7447`"
    )]
    Address {
        /// The invalid endpoint.
        endpoint: String,
        /// The protocol of the endpoint.
        protocol: String,
        /// The address of the endpoint.
        address: String,
        /// The smallest port that is allowed: 0 for listening, where the kernel then chooses a
        /// port, and 1 for connecting.
        first: u16,
    },
    /// The endpoint would accept plain text, which every host on the network could read and write.
    #[error(
        "listen on `{endpoint}`: plain TCP is for this machine alone; write `tls/{address}` for \
         others, or `unixsock-stream/PATH` or `tcp/127.0.0.1:PORT` for this machine"
    )]
    PlainText {
        /// The invalid endpoint.
        endpoint: String,
        /// The address of the endpoint.
        address: String,
    },
    /// The endpoint is for plain text, but the ecosystem is secured.
    #[error(
        "use endpoint `{endpoint}`: this ecosystem is secured; write `tls/{address}`, or \
         `unixsock-stream/PATH` for this machine"
    )]
    Unsecured {
        /// The invalid endpoint.
        endpoint: String,
        /// The address of the endpoint.
        address: String,
    },
}

/// Protocols that a secured ecosystem may use: other hosts on the network cannot read or write
/// their links.
pub(crate) const SECURED_PROTOCOLS: [&str; 2] = ["tls", "unixsock-stream"];

/// Protocols that this build supports: the transports among `zenoh`'s features in the workspace's
/// manifest.
const PROTOCOLS: [&str; 3] = ["tls", "unixsock-stream", "tcp"];

/// Checks an endpoint to connect to.
pub(crate) fn check_connect(endpoint: &str) -> Result<(), EndpointError> {
    let (protocol, address) = split(endpoint)?;
    check_address(endpoint, protocol, address, 1)
}

/// Checks an endpoint to listen on.
pub(crate) fn check_listen(endpoint: &str) -> Result<(), EndpointError> {
    let (protocol, address) = split(endpoint)?;
    check_address(endpoint, protocol, address, 0)?;
    if protocol == "tcp" && !is_loopback(address) {
        let (endpoint, address) = (endpoint.to_owned(), address.to_owned());
        return Err(EndpointError::PlainText { endpoint, address });
    }
    Ok(())
}

/// Checks an endpoint to listen on or to connect to, for a secured ecosystem.
pub(crate) fn check_secured(endpoint: &str) -> Result<(), EndpointError> {
    let (protocol, address) = split(endpoint)?;
    if SECURED_PROTOCOLS.contains(&protocol) {
        return Ok(());
    }
    Err(EndpointError::Unsecured { endpoint: endpoint.to_owned(), address: address.to_owned() })
}

/// Whether other machines can reach this daemon at an endpoint on which it listens.
pub(crate) fn leaves_machine(endpoint: &str) -> bool {
    let beyond = |(protocol, address)| protocol != "unixsock-stream" && !is_loopback(address);
    split(endpoint).is_ok_and(beyond)
}

/// Whether messages over an endpoint are neither encrypted nor authenticated.
pub(crate) fn is_plain_text(endpoint: &str) -> bool {
    split(endpoint).is_ok_and(|(protocol, _)| protocol == "tcp")
}

/// Returns host and port of an endpoint over IP, the host without brackets; `None` for other
/// endpoints.
pub(crate) fn host_and_port(endpoint: &str) -> Option<(String, u16)> {
    let (protocol, address) = split(endpoint).ok()?;
    let (host, port) = address.rsplit_once(':').filter(|_| protocol != "unixsock-stream")?;
    let host = host.trim_start_matches('[').trim_end_matches(']');
    Some((host.to_owned(), port.parse().ok()?))
}

/// Checks that the address of an endpoint over IP has a host and a port of at least `first`.
fn check_address(
    endpoint: &str,
    protocol: &str,
    address: &str,
    first: u16,
) -> Result<(), EndpointError> {
    let is_right = protocol == "unixsock-stream"
        || address.rsplit_once(':').is_some_and(|(host, port)| {
            let is_host = !host.is_empty()
                && !host.contains(char::is_whitespace)
                // Without brackets it is ambiguous where an IPv6 address ends and its port begins.
                && (!host.contains(':') || host.starts_with('[') && host.ends_with(']'));
            is_host && port.parse().is_ok_and(|port: u16| port >= first)
        });
    if is_right {
        return Ok(());
    }
    let (endpoint, protocol) = (endpoint.to_owned(), protocol.to_owned());
    Err(EndpointError::Address { endpoint, protocol, address: address.to_owned(), first })
}

/// Returns protocol and address of an endpoint, without Zenoh's metadata (`?…`) and configuration
/// (`#…`).
fn split(endpoint: &str) -> Result<(&str, &str), EndpointError> {
    let malformed = || EndpointError::Malformed(endpoint.to_owned());
    if let Some((protocol, address)) = endpoint.split_once("://") {
        let (endpoint, protocol) = (endpoint.to_owned(), protocol.to_owned());
        return Err(match PROTOCOLS.contains(&protocol.as_str()) {
            true => EndpointError::Url { endpoint, meant: format!("{protocol}/{address}") },
            false => EndpointError::UnknownProtocol { endpoint, protocol },
        });
    }
    let (protocol, rest) = endpoint.split_once('/').ok_or_else(malformed)?;
    let address = rest.split(['?', '#']).next().unwrap_or_default();
    if protocol.is_empty() || address.is_empty() {
        return Err(malformed());
    }
    if !PROTOCOLS.contains(&protocol) {
        let (endpoint, protocol) = (endpoint.to_owned(), protocol.to_owned());
        return Err(EndpointError::UnknownProtocol { endpoint, protocol });
    }
    Ok((protocol, address))
}

/// Whether only this machine can reach `HOST:PORT`. Host names count as not local, because they
/// could resolve to anything; the exception is `localhost`, which RFC 6761 fixes.
fn is_loopback(address: &str) -> bool {
    let Some((host, _port)) = address.rsplit_once(':') else { return false };
    let host = host.trim_start_matches('[').trim_end_matches(']');
    host == "localhost" || host.parse().is_ok_and(|ip: IpAddr| ip.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_text_stays_on_the_machine() {
        for good in [
            "tcp/127.0.0.1:0",
            "tcp/[::1]:7447",
            "tcp/localhost:7447",
            "tcp/127.0.0.1:7447?prio=1#so_rcvbuf=1",
            "tls/[::]:7447",
            "tls/0.0.0.0:7447",
            "unixsock-stream//run/althing/office.sock",
        ] {
            assert_eq!(check_listen(good), Ok(()), "{good}");
        }
        for bad in ["tcp/[::]:7447", "tcp/0.0.0.0:1", "tcp/192.168.1.2:7447", "tcp/office:1"] {
            assert!(matches!(check_listen(bad), Err(EndpointError::PlainText { .. })), "{bad}");
            assert_eq!(check_connect(bad), Ok(()), "{bad}");
            assert!(is_plain_text(bad) && leaves_machine(bad), "{bad}");
        }
    }

    #[test]
    fn an_address_has_a_host_and_a_port() {
        for bad in [
            "tls/office-pi",
            "tls/office-pi:744700",
            "tls/office-pi:http",
            "tls/office pi:7447",
            "tls/:7447",
            "tcp/::1:7447",
            "tls/[::]:-1",
        ] {
            for checked in [check_listen(bad), check_connect(bad)] {
                assert!(
                    matches!(checked, Err(EndpointError::Address { .. })),
                    "{bad}: {checked:?}"
                );
            }
        }
        // Port 0 lets the kernel choose when listening; nothing can connect to it.
        assert_eq!(check_listen("tls/[::]:0"), Ok(()));
        assert!(check_connect("tls/[::1]:0").is_err());
    }

    #[test]
    fn the_error_states_the_remedy() {
        let refused = |endpoint| check_listen(endpoint).expect_err(endpoint).to_string();
        assert_eq!(
            refused("tcp/[::]:7447"),
            "listen on `tcp/[::]:7447`: plain TCP is for this machine alone; write \
             `tls/[::]:7447` for others, or `unixsock-stream/PATH` or `tcp/127.0.0.1:PORT` for \
             this machine"
        );
        assert_eq!(
            refused("quic/[::]:7447"),
            "use endpoint `quic/[::]:7447`: this build speaks tls, unixsock-stream, tcp, not `quic`"
        );
        for malformed in ["", "office-pi", "tls/", "/x", "tcp/#a"] {
            assert!(matches!(check_connect(malformed), Err(EndpointError::Malformed(_))));
        }
    }
}
