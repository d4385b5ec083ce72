//! A server on loopback, and a client that sends requests as they stand.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use accounts::{
    Accounts, PasswordCost, PeopleFile, PersonName, PersonRecord, PersonRight, RequestLog,
    StoredPassword, StoredToken,
};
use serde_json::Value;
use tokio::io::{AsyncBufReadExt as _, AsyncReadExt as _, AsyncWriteExt as _, BufReader};
use tokio::net::TcpStream;
use tokio::task::JoinHandle;
use tokio::time::timeout;
use web_page::{PageOptions, PageServer, PageTls};

use crate::made_up::MadeUp;

/// How long a test waits for what must come.
pub(crate) const PATIENCE: Duration = Duration::from_secs(30);

pub(crate) const PASSWORD: &str = "correct-horse-battery";

/// A server that is served until this value is dropped.
pub(crate) struct Served {
    pub(crate) address: SocketAddr,
    pub(crate) host: Arc<MadeUp>,
    pub(crate) log: Arc<RequestLog>,
    pub(crate) people: PathBuf,
    /// Token of a program of `ada`.
    pub(crate) token: String,
    _folder: tempfile::TempDir,
    task: JoinHandle<()>,
}

/// A person that has signed in.
#[derive(Clone)]
pub(crate) struct Session {
    pub(crate) cookie: String,
    pub(crate) csrf: String,
}

/// An answer.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) status: u16,
    pub(crate) head: String,
    pub(crate) body: Vec<u8>,
}

fn person(name: &str, rights: &[PersonRight]) -> PersonRecord {
    PersonRecord {
        name: PersonName::new(name).expect("a name"),
        rights: rights.iter().copied().collect(),
        password: Some(StoredPassword::hash(PASSWORD, PasswordCost::FOR_TESTS).expect("random")),
        tokens: Vec::new(),
        screen: None,
    }
}

impl Served {
    pub(crate) async fn new() -> Served {
        Served::with(PageOptions::default(), None).await
    }

    /// Serves a made-up ecosystem to `ada`, who may everything, `ben`, who may look, and `cleo`,
    /// who may only ask.
    pub(crate) async fn with(options: PageOptions, tls: Option<PageTls>) -> Served {
        let folder = tempfile::tempdir().expect("a folder");
        let people = folder.path().join("people.toml");
        let program = PersonName::new("program").expect("a name");
        let (token, stored) = StoredToken::make(program, SystemTime::now()).expect("random");
        let mut ada = person("ada", &PersonRight::ALL);
        ada.tokens.push(stored);
        let add = PeopleFile::new(&people).change(|file| {
            file.add(ada)?;
            file.add(person("ben", &[PersonRight::Look]))?;
            file.add(person("cleo", &[PersonRight::Ask]))
        });
        add.expect("written");
        let accounts = Accounts::open_with(people.clone(), PasswordCost::FOR_TESTS);
        let accounts = Arc::new(accounts.expect("the file can be read"));
        let log = Arc::new(RequestLog::open(folder.path()).expect("a log"));
        let host = MadeUp::new(20);
        let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let server = PageServer::bind(any, tls, options).await.expect("a free port");
        let address = server.address().expect("a socket");
        let (page_host, page_log) = (Arc::clone(&host), Arc::clone(&log));
        let task = tokio::spawn(server.serve(page_host, accounts, Some(page_log)));
        Served { address, host, log, people, token, _folder: folder, task }
    }

    pub(crate) async fn connect(&self) -> TcpStream {
        TcpStream::connect(self.address).await.expect("it listens")
    }

    /// Sends a request as it stands, and returns the answer.
    pub(crate) async fn raw(&self, request: &[u8]) -> Answer {
        let mut stream = self.connect().await;
        stream.write_all(request).await.expect("it is connected");
        read_answer(&mut stream).await
    }

    /// Sends a request with headers, each line of which ends with a line break.
    pub(crate) async fn ask(&self, line: &str, headers: &str, body: &str) -> Answer {
        self.raw(request(line, &self.address.to_string(), headers, body).as_bytes()).await
    }

    /// Sends a request as a page does.
    pub(crate) async fn page(&self, session: &Session, line: &str, body: &str) -> Answer {
        self.ask(line, &self.headers(session), body).await
    }

    /// Returns the headers of a request of a page.
    pub(crate) fn headers(&self, session: &Session) -> String {
        let (address, Session { cookie, csrf }) = (self.address, session);
        format!(
            "Origin: http://{address}\r\nCookie: {cookie}\r\nX-Althing-CSRF: {csrf}\r\n\
             Content-Type: application/json\r\n"
        )
    }

    pub(crate) async fn try_sign_in(&self, name: &str, password: &str) -> Answer {
        let origin =
            format!("Origin: http://{}\r\nContent-Type: application/json\r\n", self.address);
        let body = serde_json::json!({ "name": name, "password": password }).to_string();
        self.ask("POST /api/sign-in", &origin, &body).await
    }

    pub(crate) async fn sign_in(&self, name: &str) -> Session {
        let answer = self.try_sign_in(name, PASSWORD).await;
        assert_eq!(answer.status, 200, "{answer:?}");
        let cookie = answer.header("set-cookie").expect("a cookie");
        let cookie = cookie.split(';').next().expect("a pair").to_owned();
        let csrf = answer.json()["csrf"].as_str().expect("a text").to_owned();
        Session { cookie, csrf }
    }

    /// Opens the event stream of a page.
    pub(crate) async fn events(&self, session: &Session, topics: &str) -> Events {
        let headers = self.headers(session);
        Events::open(self, topics, &headers).await.expect("the stream is open")
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        self.task.abort();
    }
}

pub(crate) fn request(line: &str, host: &str, headers: &str, body: &str) -> String {
    let length = body.len();
    format!(
        "{line} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{headers}Content-Length: {length}\
         \r\n\r\n{body}"
    )
}

/// Reads an answer to its end; its status is 0 if there is none.
pub(crate) async fn read_answer(stream: &mut (impl tokio::io::AsyncRead + Unpin)) -> Answer {
    let mut bytes = Vec::new();
    // An error is a closed connection; what came before it counts.
    let _ = timeout(PATIENCE, stream.read_to_end(&mut bytes)).await.expect("it ends in time");
    let end = bytes.windows(4).position(|four| four == b"\r\n\r\n").unwrap_or(bytes.len());
    let head = String::from_utf8_lossy(&bytes[..end]).into_owned();
    let status = head.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or(0);
    let body = bytes.get(end + 4..).unwrap_or_default().to_vec();
    Answer { status, head, body }
}

impl Answer {
    pub(crate) fn header(&self, name: &str) -> Option<&str> {
        let lines = self.head.lines().filter_map(|line| line.split_once(": "));
        lines.into_iter().find(|(known, _)| known.eq_ignore_ascii_case(name)).map(|(_, it)| it)
    }

    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_default()
    }

    /// Returns the problem that the answer states.
    pub(crate) fn problem(&self) -> String {
        self.json()["problem"].as_str().unwrap_or_default().to_owned()
    }
}

/// One event of a stream.
#[derive(Debug)]
pub(crate) struct Event {
    pub(crate) topic: String,
    pub(crate) id: String,
    pub(crate) data: Value,
}

/// An open event stream.
pub(crate) struct Events {
    lines: BufReader<TcpStream>,
}

impl Events {
    /// Opens a stream.
    ///
    /// # Errors
    ///
    /// Returns the head of the answer if it is no stream.
    pub(crate) async fn open(
        served: &Served,
        topics: &str,
        headers: &str,
    ) -> Result<Events, String> {
        let mut stream = served.connect().await;
        let line = format!("GET /api/events?topics={topics}");
        let request = format!("{line} HTTP/1.1\r\nHost: {}\r\n{headers}\r\n", served.address);
        stream.write_all(request.as_bytes()).await.expect("it is connected");
        let (mut lines, mut head) = (BufReader::new(stream), String::new());
        while !head.ends_with("\r\n\r\n") {
            let read = timeout(PATIENCE, lines.read_line(&mut head)).await.expect("in time");
            if read.expect("readable") == 0 {
                break;
            }
        }
        match head.starts_with("HTTP/1.1 200 ") {
            true => Ok(Events { lines }),
            false => Err(head),
        }
    }

    /// Returns the next line of the stream, without what HTTP adds; `None` at its end.
    async fn line(&mut self) -> Option<String> {
        loop {
            let mut line = String::new();
            let read = timeout(PATIENCE, self.lines.read_line(&mut line)).await.expect("in time");
            if read.unwrap_or(0) == 0 {
                return None;
            }
            let text = line.trim_end();
            if text == "0" {
                // The last chunk; the connection may serve further requests.
                return None;
            }
            // The lengths of chunks are hexadecimal numbers.
            let is_length = !text.is_empty() && u64::from_str_radix(text, 16).is_ok();
            if !is_length && !text.is_empty() {
                return Some(text.to_owned());
            }
        }
    }

    /// Returns the next event; `None` at the end of the stream.
    pub(crate) async fn next(&mut self) -> Option<Event> {
        let (mut topic, mut id) = (String::new(), String::new());
        loop {
            let line = self.line().await?;
            if let Some(text) = line.strip_prefix("event: ") {
                topic = text.to_owned();
            } else if let Some(text) = line.strip_prefix("id: ") {
                id = text.to_owned();
            } else if let Some(text) = line.strip_prefix("data: ") {
                let data = serde_json::from_str(text).expect("JSON on one line");
                return Some(Event { topic, id, data });
            }
        }
    }

    /// Returns the first event that `is` accepts.
    pub(crate) async fn find(&mut self, is: impl Fn(&Event) -> bool) -> Event {
        loop {
            let event = self.next().await.expect("the stream goes on");
            if is(&event) {
                return event;
            }
        }
    }
}
