//! What is answered to a request: metrics, health, or why neither.

use std::net::IpAddr;
use std::sync::Arc;

use bytes::Bytes;
use http_body_util::Full;
use hyper::header::{self, HeaderMap, HeaderValue};
use hyper::{Method, Request, Response, StatusCode};

use crate::exposition::ExpositionFormat;
use crate::family::MetricFamily;

/// Where metrics are.
const METRICS: &str = "/metrics";
/// Where the health of the process is.
const HEALTH: &str = "/healthz";

const PLAIN_TEXT: &str = "text/plain; charset=utf-8";

/// Health of a process: the problems that keep it from its work.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Health {
    /// The problems, each as one sentence for a person. A process without problems is healthy.
    pub problems: Vec<String>,
}

/// The process that is observed. Each request calls one of these functions, on the thread that
/// answers it, so they must not block.
pub trait MetricsSource: Send + Sync + 'static {
    /// Returns the metrics at this moment.
    fn metrics(&self) -> Vec<MetricFamily>;

    /// Returns the health at this moment.
    fn health(&self) -> Health;
}

/// Answers requests on one listener.
pub(crate) struct Responder {
    source: Arc<dyn MetricsSource>,
    /// Whether requests are answered only if they name the host by an address, or as `localhost`. A
    /// web page in a browser of this machine can let its own name lead here, and would else read the
    /// answer.
    requires_address: bool,
}

impl Responder {
    /// Creates a responder. `is_encrypted` states whether clients prove who they are by TLS.
    pub(crate) fn new(source: Arc<dyn MetricsSource>, is_encrypted: bool) -> Responder {
        Responder { source, requires_address: !is_encrypted }
    }

    /// Returns the answer to a request; its body is not read.
    pub(crate) fn respond<B>(&self, request: &Request<B>) -> Response<Full<Bytes>> {
        if self.requires_address && !names_address(request) {
            let text =
                "name this machine once, in the header Host, by an address or as localhost\n";
            return answer(StatusCode::MISDIRECTED_REQUEST, PLAIN_TEXT, text.to_owned());
        }
        if !matches!(*request.method(), Method::GET | Method::HEAD) {
            let text = "only GET and HEAD are answered\n".to_owned();
            let mut refusal = answer(StatusCode::METHOD_NOT_ALLOWED, PLAIN_TEXT, text);
            refusal.headers_mut().insert(header::ALLOW, HeaderValue::from_static("GET, HEAD"));
            return refusal;
        }
        match request.uri().path() {
            METRICS => self.metrics(request.headers()),
            HEALTH => self.health(),
            "/" => answer(StatusCode::OK, PLAIN_TEXT, format!("{METRICS}\n{HEALTH}\n")),
            _ => {
                let text = format!("there are {METRICS} and {HEALTH}\n");
                answer(StatusCode::NOT_FOUND, PLAIN_TEXT, text)
            }
        }
    }

    fn metrics(&self, headers: &HeaderMap) -> Response<Full<Bytes>> {
        let accepted = headers.get_all(header::ACCEPT).iter().filter_map(|it| it.to_str().ok());
        let accepted: Vec<_> = accepted.collect();
        let format = ExpositionFormat::accepted(&accepted.join(","));
        let text = format.write(&self.source.metrics());
        answer(StatusCode::OK, format.content_type(), text)
    }

    fn health(&self) -> Response<Full<Bytes>> {
        let Health { problems } = self.source.health();
        if problems.is_empty() {
            return answer(StatusCode::OK, PLAIN_TEXT, "ok\n".to_owned());
        }
        let text = problems.iter().map(|problem| format!("{problem}\n")).collect();
        answer(StatusCode::SERVICE_UNAVAILABLE, PLAIN_TEXT, text)
    }
}

fn answer(status: StatusCode, media_type: &'static str, text: String) -> Response<Full<Bytes>> {
    let mut response = Response::new(Full::new(Bytes::from(text)));
    *response.status_mut() = status;
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(media_type));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    response
}

/// Whether a request names this machine once, by an address or as `localhost`.
fn names_address<B>(request: &Request<B>) -> bool {
    let mut hosts = request.headers().get_all(header::HOST).iter();
    let (Some(host), None) = (hosts.next(), hosts.next()) else { return false };
    let Ok(host) = host.to_str() else { return false };
    // Only proxies are asked for whole addresses.
    if request.uri().authority().is_some() {
        return false;
    }
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Patient(Vec<String>);

    impl MetricsSource for Patient {
        fn metrics(&self) -> Vec<MetricFamily> {
            vec![MetricFamily::gauge("x_up", "Whether it runs.").with(1.0)]
        }

        fn health(&self) -> Health {
            Health { problems: self.0.clone() }
        }
    }

    fn status(method: Method, path: &str, host: Option<&str>, problems: &[&str]) -> u16 {
        let problems = problems.iter().map(|it| (*it).to_owned()).collect();
        let responder = Responder::new(Arc::new(Patient(problems)), false);
        let mut request = Request::builder().method(method).uri(path);
        if let Some(host) = host {
            request = request.header(header::HOST, host);
        }
        responder.respond(&request.body(()).expect("a request")).status().as_u16()
    }

    #[test]
    fn only_the_known_paths_are_answered() {
        for (method, path, expected) in [
            (Method::GET, "/metrics", 200),
            (Method::HEAD, "/metrics?name=x", 200),
            (Method::GET, "/healthz", 200),
            (Method::GET, "/", 200),
            (Method::GET, "/metrics/", 404),
            (Method::GET, "/../etc/passwd", 404),
            (Method::POST, "/metrics", 405),
            (Method::DELETE, "/healthz", 405),
        ] {
            assert_eq!(
                status(method.clone(), path, Some("localhost"), &[]),
                expected,
                "{method} {path}"
            );
        }
        assert_eq!(status(Method::GET, "/healthz", Some("[::1]:1"), &["no disk"]), 503);
    }

    #[test]
    fn a_request_for_another_host_is_refused() {
        for host in ["127.0.0.1:9464", "[::1]:9464", "[::1]", "localhost", "LocalHost:1", "::1"] {
            let expected = if host == "::1" { 421 } else { 200 };
            assert_eq!(status(Method::GET, "/metrics", Some(host), &[]), expected, "{host}");
        }
        for host in ["evil.example", "evil.example:9464", "", "127.0.0.1.evil.example", "["] {
            assert_eq!(status(Method::GET, "/metrics", Some(host), &[]), 421, "{host}");
        }
        assert_eq!(status(Method::GET, "/metrics", None, &[]), 421, "it names none");
        let whole = "http://evil.example/metrics";
        assert_eq!(status(Method::GET, whole, Some("127.0.0.1"), &[]), 421, "it names two");
        let hosts = ["127.0.0.1", "evil.example"];
        let two = Request::builder().uri("/metrics").header(header::HOST, hosts[0]);
        let two = two.header(header::HOST, hosts[1]).body(()).expect("a request");
        let responder = Responder::new(Arc::new(Patient(Vec::new())), false);
        assert_eq!(responder.respond(&two).status(), StatusCode::MISDIRECTED_REQUEST);
    }
}
