//! A receiver of HTTP requests, for tests of what is sent: it reads one request after the other, and
//! answers each alike.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::mpsc::{self, Receiver};
use std::time::SystemTime;

use serde_json::Value;

/// A request that has arrived, and when.
#[derive(Debug)]
pub(crate) struct ReceivedRequest {
    /// The first line and the headers, in lower case.
    pub(crate) head: Vec<String>,
    pub(crate) body: Value,
    pub(crate) at: SystemTime,
}

/// Receives requests with JSON bodies, and answers each with this text.
pub(crate) fn received(listener: TcpListener, answer: &'static str) -> Receiver<ReceivedRequest> {
    let (tell, told) = mpsc::channel();
    std::thread::spawn(move || {
        for stream in listener.incoming().map_while(Result::ok) {
            let Some((head, body)) = serve(&stream, answer) else { continue };
            if tell.send(ReceivedRequest { head, body, at: SystemTime::now() }).is_err() {
                return;
            }
        }
    });
    told
}

/// Reads one request, and answers it.
fn serve(stream: &TcpStream, answer: &str) -> Option<(Vec<String>, Value)> {
    let mut reader = BufReader::new(stream);
    let mut head = Vec::new();
    loop {
        let mut line = String::new();
        reader.read_line(&mut line).ok()?;
        match line.trim_end() {
            "" => break,
            line => head.push(line.to_lowercase()),
        }
    }
    let length = head.iter().find_map(|line| line.strip_prefix("content-length: "))?;
    let mut body = vec![0; length.parse().ok()?];
    reader.read_exact(&mut body).ok()?;
    (&mut &*stream).write_all(answer.as_bytes()).ok()?;
    Some((head, serde_json::from_slice(&body).ok()?))
}
