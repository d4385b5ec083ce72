//! Where a request comes from: by which name it calls this server, and which page has made it. A
//! page of another site can send requests with the cookies of a person, and can let its own name
//! lead here.

use std::net::IpAddr;

use axum::http::header::{self, HeaderName};
use axum::http::{HeaderMap, Method, StatusCode, Uri};

use crate::answer::Refused;

/// States which page has made a request: `same-origin`, `cross-site`, …; only browsers set it.
const SEC_FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");

/// Checks that a request calls this server by a name of its own.
///
/// # Errors
///
/// Returns a refusal if it names another host, or none, or several.
pub(crate) fn check_host<'h>(headers: &'h HeaderMap, names: &[String]) -> Result<&'h str, Refused> {
    let misdirected = |problem: &str| Refused::new(StatusCode::MISDIRECTED_REQUEST, problem);
    let mut hosts = headers.get_all(header::HOST).iter();
    let (Some(host), None) = (hosts.next(), hosts.next()) else {
        return Err(misdirected("a request names one host, in the header Host"));
    };
    let host = host.to_str().map_err(|_| misdirected("the header Host is not a name"))?;
    let Some(name) = host_name(host) else {
        return Err(misdirected("the header Host is not a name"));
    };
    // An address is no name that another site could let lead here.
    let is_own = name.eq_ignore_ascii_case("localhost")
        || name.parse::<IpAddr>().is_ok()
        || names.iter().any(|own| own.eq_ignore_ascii_case(name));
    if is_own {
        return Ok(host);
    }
    Err(misdirected(
        "the header Host names another machine; ask by an address, localhost, or a name in `names` \
         of `[web]`",
    ))
}

/// Returns the name in a header Host, without its port.
fn host_name(host: &str) -> Option<&str> {
    let (name, port) = match host.strip_prefix('[') {
        Some(rest) => rest.split_once(']')?,
        None => host.split_at(host.find(':').unwrap_or(host.len())),
    };
    let is_port = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let has_port = port.is_empty() || port.strip_prefix(':').is_some_and(is_port);
    (!name.is_empty() && has_port).then_some(name)
}

/// Checks that a request which uses a person's cookies was made by a page of this server.
///
/// # Errors
///
/// Returns a refusal if another page has made it, or if the request does not say which one has made
/// it, although it changes something.
pub(crate) fn check_origin(
    method: &Method,
    headers: &HeaderMap,
    host: &str,
    is_encrypted: bool,
) -> Result<(), Refused> {
    let foreign = || {
        let problem = "the request was made by a page of another origin";
        Err(Refused::new(StatusCode::FORBIDDEN, problem))
    };
    let mut sites = headers.get_all(SEC_FETCH_SITE).iter();
    let site = sites.next().map(|site| site.as_bytes());
    let is_reading = matches!(*method, Method::GET | Method::HEAD);
    // A person may type an address, or open a picture in a window of its own.
    let is_typed = is_reading && site == Some(b"none");
    let is_foreign = site.is_some_and(|site| site != b"same-origin") && !is_typed;
    if sites.next().is_some() || is_foreign {
        return foreign();
    }
    let mut origins = headers.get_all(header::ORIGIN).iter();
    let origin = origins.next();
    if origins.next().is_some()
        || origin.is_some_and(|it| !is_own(it.as_bytes(), host, is_encrypted))
    {
        return foreign();
    }
    if !is_reading && origin.is_none() && site.is_none() {
        let problem = "the request does not say which page has made it (header Origin)";
        return Err(Refused::new(StatusCode::FORBIDDEN, problem));
    }
    Ok(())
}

/// Whether an origin is that of the pages of this server, as the browser calls it.
fn is_own(origin: &[u8], host: &str, is_encrypted: bool) -> bool {
    let scheme: &[u8] = if is_encrypted { b"https://" } else { b"http://" };
    let standard = if is_encrypted { ":443" } else { ":80" };
    let named = host.strip_suffix(standard).unwrap_or(host).as_bytes();
    origin.strip_prefix(scheme).is_some_and(|rest| rest.eq_ignore_ascii_case(named))
}

/// Checks that the target of a request is a path: only proxies are asked for whole addresses.
///
/// # Errors
///
/// Returns a refusal otherwise.
pub(crate) fn check_target(uri: &Uri) -> Result<(), Refused> {
    if uri.authority().is_none() && uri.path().starts_with('/') {
        return Ok(());
    }
    Err(Refused::new(StatusCode::BAD_REQUEST, "a request names a path of this server"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(of: &[(&'static str, &str)]) -> HeaderMap {
        let mut headers = HeaderMap::new();
        for (name, value) in of {
            headers.append(*name, value.parse().expect("a value"));
        }
        headers
    }

    #[test]
    fn only_own_names_are_answered() {
        let names = ["Pi.example".to_owned()];
        for host in
            ["127.0.0.1:8080", "[::1]:8080", "[::1]", "localhost", "LOCALHOST:1", "pi.Example:443"]
        {
            assert!(check_host(&headers(&[("host", host)]), &names).is_ok(), "{host}");
        }
        for host in [
            "evil.example",
            "127.0.0.1.evil.example",
            "",
            "[",
            "[::1",
            "::1",
            "localhost:",
            "localhost:x",
            "pi.example.evil",
            "localhost@evil",
            "localhost/",
        ] {
            assert!(check_host(&headers(&[("host", host)]), &names).is_err(), "{host}");
        }
        assert!(check_host(&headers(&[]), &names).is_err());
        let two = headers(&[("host", "localhost"), ("host", "evil.example")]);
        assert!(check_host(&two, &names).is_err());
    }

    #[test]
    fn only_own_pages_change_something() {
        let check = |method: Method, of: &[(&'static str, &str)], encrypted| {
            check_origin(&method, &headers(of), "pi:8443", encrypted).is_ok()
        };
        let own = [("origin", "https://pi:8443")];
        assert!(check(Method::POST, &own, true));
        assert!(check(Method::POST, &[("sec-fetch-site", "same-origin")], true));
        assert!(check(Method::GET, &[], true));
        assert!(check(Method::GET, &[("sec-fetch-site", "none")], true), "a typed address");
        assert!(!check(Method::POST, &[], true), "nothing says where it comes from");
        assert!(!check(Method::POST, &own, false), "another scheme");
        for origin in [
            "null",
            "https://pi",
            "https://evil:8443",
            "http://pi:8443",
            "https://pi:8443/",
            "file://",
        ] {
            assert!(!check(Method::POST, &[("origin", origin)], true), "{origin}");
            assert!(!check(Method::GET, &[("origin", origin)], true), "{origin}");
        }
        for site in ["cross-site", "same-site", "none", ""] {
            let both = [own[0], ("sec-fetch-site", site)];
            assert!(!check(Method::POST, &both, true), "{site}");
        }
        assert!(!check(Method::POST, &[own[0], own[0]], true), "twice");
        let origin = headers(&[("origin", "https://pi")]);
        assert!(check_origin(&Method::POST, &origin, "pi:443", true).is_ok());
    }
}
