//! A client of a daemon's page, over a raw connection as a browser opens one: signs in, asks, and
//! reads events.

use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::Stdio;
use std::sync::Arc;
use std::time::Instant;

use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, ServerName};
use rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};
use serde_json::{Value, json};

use super::{Office, PATIENCE};

/// The password of every person in the tests.
pub(crate) const PASSWORD: &str = "correct horse battery";

/// A connection, encrypted or not.
trait Wire: Read + Write + Send {}

impl<T: Read + Write + Send> Wire for T {}

/// The address of a page, and the authority that its visitor trusts.
#[derive(Clone)]
pub(crate) struct PageAddress {
    pub(crate) port: u16,
    tls: Option<Arc<ClientConfig>>,
}

/// A person that has signed in.
pub(crate) struct Visitor {
    at: PageAddress,
    cookie: String,
    csrf: String,
}

/// An answer to a request; the body is null if it is not JSON.
#[derive(Debug)]
pub(crate) struct PageAnswer {
    pub(crate) status: u16,
    pub(crate) head: String,
    pub(crate) body: Value,
}

/// The events of one page, and the rows that they have told so far, by topic and key.
pub(crate) struct PageEvents {
    stream: BufReader<Box<dyn Wire>>,
    text: String,
    rows: BTreeMap<String, BTreeMap<String, Value>>,
}

/// Returns a port that no program has.
pub(crate) fn free_port() -> u16 {
    // The kernel does not give the same free port to another process soon, so it can be used later.
    let socket = TcpListener::bind("127.0.0.1:0").and_then(|socket| socket.local_addr());
    socket.expect("a port").port()
}

/// Adds a person to the people of an office, with these options of `althing people add`.
pub(crate) fn add_person(office: &Office, name: &str, options: &[&str]) {
    let file = office.file.display().to_string();
    let arguments = [&["people", "add", name, "--ecosystem", &file], options].concat();
    let mut command = office.command(&arguments);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("the binary is built");
    let mut stdin = child.stdin.take().expect("piped");
    writeln!(stdin, "{PASSWORD}").expect("it reads");
    drop(stdin);
    let output = child.wait_with_output().expect("it ends");
    assert!(output.status.success(), "{}", super::stderr(&output));
}

// === impl PageAddress ===

impl PageAddress {
    pub(crate) fn plain(port: u16) -> PageAddress {
        PageAddress { port, tls: None }
    }

    /// Returns the address of an encrypted page, of which the certificate must be one of the
    /// authority in this file.
    pub(crate) fn encrypted(port: u16, authority: &Path) -> PageAddress {
        let mut roots = RootCertStore::empty();
        let authority = CertificateDer::from_pem_file(authority).expect("a certificate");
        roots.add(authority).expect("an authority");
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let config = ClientConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()
            .expect("versions")
            .with_root_certificates(roots)
            .with_no_client_auth();
        PageAddress { port, tls: Some(Arc::new(config)) }
    }

    fn open(&self) -> Option<Box<dyn Wire>> {
        let stream = TcpStream::connect(("127.0.0.1", self.port)).ok()?;
        stream.set_read_timeout(Some(PATIENCE)).expect("a socket");
        let Some(config) = &self.tls else { return Some(Box::new(stream)) };
        let name = ServerName::try_from("localhost").expect("a name");
        let client = ClientConnection::new(Arc::clone(config), name).expect("a client");
        Some(Box::new(StreamOwned::new(client, stream)))
    }

    /// Waits until the page is served: the daemon is ready before.
    pub(crate) fn await_page(&self) {
        let deadline = Instant::now() + PATIENCE;
        while self.request("GET", "/", "", None).is_none() {
            assert!(Instant::now() < deadline, "no page is served");
        }
    }

    /// Returns the address of a page, as a browser opens it.
    pub(crate) fn url(&self, path: &str) -> String {
        self.origin() + path
    }

    fn origin(&self) -> String {
        let scheme = if self.tls.is_some() { "https" } else { "http" };
        format!("{scheme}://localhost:{}", self.port)
    }

    /// Sends a request and reads the answer; `None` if there is none.
    pub(crate) fn request(
        &self,
        method: &str,
        path: &str,
        headers: &str,
        body: Option<&Value>,
    ) -> Option<PageAnswer> {
        let mut stream = self.open()?;
        let request = self.written(method, path, &format!("Connection: close\r\n{headers}"), body);
        stream.write_all(request.as_bytes()).ok()?;
        stream.flush().ok()?;
        let mut bytes = Vec::new();
        // A TLS peer may close the connection without a farewell.
        let _ = stream.read_to_end(&mut bytes);
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let (head, body) = text.split_once("\r\n\r\n")?;
        let status = head.split(' ').nth(1)?.parse().ok()?;
        let body = serde_json::from_str(body).unwrap_or(Value::Null);
        Some(PageAnswer { status, head: head.to_owned(), body })
    }

    fn written(&self, method: &str, path: &str, headers: &str, body: Option<&Value>) -> String {
        let body = body.map(Value::to_string).unwrap_or_default();
        let (port, origin, length) = (self.port, self.origin(), body.len());
        let content = match method {
            "POST" => format!(
                "Origin: {origin}\r\nContent-Type: application/json\r\nContent-Length: {length}\r\n"
            ),
            _ => String::new(),
        };
        format!(
            "{method} {path} HTTP/1.1\r\nHost: localhost:{port}\r\n\
             Sec-Fetch-Site: same-origin\r\n{content}{headers}\r\n{body}"
        )
    }

    /// Signs a person in; returns the answer if that is refused.
    pub(crate) fn sign_in(&self, name: &str, password: &str) -> Result<Visitor, PageAnswer> {
        let said = json!({ "name": name, "password": password });
        let answer = self.request("POST", "/api/sign-in", "", Some(&said)).expect("an answer");
        if answer.status != 200 {
            return Err(answer);
        }
        let mut lines = answer.head.lines();
        let cookie = lines.find_map(|line| {
            let (name, value) = line.split_once(": ")?;
            name.eq_ignore_ascii_case("set-cookie").then(|| value.split(';').next())?
        });
        let cookie = cookie.expect("a cookie").to_owned();
        let csrf = answer.body["csrf"].as_str().expect("a token").to_owned();
        Ok(Visitor { at: self.clone(), cookie, csrf })
    }

    /// Signs a person in that is known.
    #[track_caller]
    pub(crate) fn visit(&self, name: &str) -> Visitor {
        let signed_in = self.sign_in(name, PASSWORD);
        signed_in.unwrap_or_else(|refused| panic!("{name} cannot sign in: {refused:?}"))
    }
}

// === impl Visitor ===

impl Visitor {
    fn headers(&self) -> String {
        format!("Cookie: {}\r\nX-Althing-CSRF: {}\r\n", self.cookie, self.csrf)
    }

    pub(crate) fn get(&self, path: &str) -> PageAnswer {
        self.at.request("GET", path, &self.headers(), None).expect("an answer")
    }

    /// Asks for an act; returns the answer.
    pub(crate) fn ask(&self, act: &Value) -> PageAnswer {
        self.at.request("POST", "/api/acts", &self.headers(), Some(act)).expect("an answer")
    }

    /// Asks for an act that is carried out; returns its outcome.
    #[track_caller]
    pub(crate) fn act(&self, act: Value) -> Value {
        let answer = self.ask(&act);
        assert_eq!(answer.status, 200, "{act}: {answer:?}");
        assert_eq!(answer.body["ok"], true, "{act}: {}", answer.body);
        answer.body
    }

    /// Opens the events of these topics.
    pub(crate) fn events(&self, topics: &str) -> PageEvents {
        let mut stream = self.at.open().expect("a connection");
        let path = format!("/api/events?topics={topics}");
        let request = self.at.written("GET", &path, &self.headers(), None);
        stream.write_all(request.as_bytes()).expect("it reads");
        stream.flush().expect("it reads");
        let mut events = PageEvents {
            stream: BufReader::new(stream),
            text: String::new(),
            rows: BTreeMap::new(),
        };
        let head = events.head().expect("an answer");
        assert!(head.contains(" 200 ") && head.contains("text/event-stream"), "{head}");
        events
    }
}

// === impl PageEvents ===

impl PageEvents {
    fn head(&mut self) -> Option<String> {
        let mut head = String::new();
        while !head.ends_with("\r\n\r\n") {
            if self.stream.read_line(&mut head).ok()? == 0 {
                return None;
            }
        }
        Some(head)
    }

    /// Reads one chunk of the answer; `None` at its end.
    fn chunk(&mut self) -> Option<String> {
        let mut size = String::new();
        self.stream.read_line(&mut size).ok()?;
        let size = usize::from_str_radix(size.trim(), 16).ok().filter(|size| *size > 0)?;
        let mut bytes = vec![0; size + 2];
        self.stream.read_exact(&mut bytes).ok()?;
        bytes.truncate(size);
        String::from_utf8(bytes).ok()
    }

    /// Reads one event, and notes its rows. Returns `false` at the end of the stream.
    fn next(&mut self) -> bool {
        loop {
            if let Some((event, rest)) = self.text.split_once("\n\n") {
                let (event, rest) = (event.to_owned(), rest.to_owned());
                self.text = rest;
                if self.note(&event) {
                    return true;
                }
                continue;
            }
            match self.chunk() {
                Some(chunk) => self.text += &chunk,
                None => return false,
            }
        }
    }

    /// Notes an event; returns `false` if it is a comment.
    fn note(&mut self, event: &str) -> bool {
        let field = |name: &str| {
            let prefix = format!("{name}: ");
            event.lines().filter_map(|line| line.strip_prefix(&prefix)).collect::<Vec<_>>().join("")
        };
        let (topic, data) = (field("event"), field("data"));
        let Ok(data) = serde_json::from_str::<Value>(&data) else { return false };
        let rows = self.rows.entry(topic).or_default();
        if data["full"] == true {
            rows.clear();
        }
        for (key, row) in data["rows"].as_object().into_iter().flatten() {
            rows.insert(key.clone(), row.clone());
        }
        for gone in data["gone"].as_array().into_iter().flatten().filter_map(Value::as_str) {
            rows.remove(gone);
        }
        true
    }

    /// Reads events until a row of the topic is as wanted; returns the row.
    #[track_caller]
    pub(crate) fn await_row(&mut self, topic: &str, is_wanted: impl Fn(&Value) -> bool) -> Value {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let rows = self.rows.get(topic).into_iter().flatten();
            if let Some((_, row)) = rows.into_iter().find(|(_, row)| is_wanted(row)) {
                return row.clone();
            }
            assert!(Instant::now() < deadline, "{topic}: {:#?}", self.rows);
            assert!(self.next(), "the events have ended: {:#?}", self.rows);
        }
    }

    /// Returns the rows of a topic so far.
    pub(crate) fn rows(&self, topic: &str) -> Vec<Value> {
        self.rows.get(topic).into_iter().flatten().map(|(_, row)| row.clone()).collect()
    }

    /// Reads events until the daemon ends the stream.
    pub(crate) fn await_end(&mut self) {
        let deadline = Instant::now() + PATIENCE;
        while self.next() {
            assert!(Instant::now() < deadline, "the events do not end");
        }
    }
}
