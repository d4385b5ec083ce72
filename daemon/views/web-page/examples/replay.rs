//! Serves the pages of a recording, or of a made-up ecosystem, without a daemon: for work on the
//! pages and for tests of them. Acts are answered by a made-up host.
//!
//! ```text
//! cargo run -p web-page --example replay -- --agents 100 --hertz 1 --person ada --password PASSWORD
//! cargo run -p web-page --example replay -- --record office.jsonl --person ada --password PASSWORD
//! ```
//!
//! `--listen 127.0.0.1:0` lets the system choose a port; the address is printed on the first line.
//! `--assets FOLDER` takes the files of the pages from a folder. `--rights look,ask` limits the
//! person. `--question` and `--discovered` make a question and a discovered agent at the start.

mod made_up;

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use accounts::{
    Accounts, PasswordCost, PeopleFile, PersonName, PersonRecord, PersonRight, RequestLog,
    StoredPassword,
};
use acl::Message;
use live_view::ViewEvent;
use made_up::MadeUp;
use serde::Deserialize;
use web_page::{PageOptions, PageServer, PageTls, PageTlsFiles};

/// A line of a recording after the first.
#[derive(Deserialize)]
struct Recorded {
    at_ms: u64,
    message: Message,
}

type Settings = BTreeMap<String, String>;

fn settings() -> Result<Settings, String> {
    let (mut settings, mut arguments) = (Settings::new(), std::env::args().skip(1));
    while let Some(argument) = arguments.next() {
        let name = argument.strip_prefix("--").ok_or(format!("`{argument}` is no option"))?;
        let is_flag = ["question", "discovered"].contains(&name);
        let value = if is_flag { Some(String::new()) } else { arguments.next() };
        settings.insert(name.to_owned(), value.ok_or(format!("`--{name}` has no value"))?);
    }
    Ok(settings)
}

#[tokio::main]
async fn main() -> Result<(), Box<dyn std::error::Error>> {
    let settings = settings()?;
    let get = |name: &str, default: &str| {
        settings.get(name).cloned().unwrap_or_else(|| default.to_owned())
    };
    let folder = std::env::temp_dir().join(format!("althing-replay-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let accounts = people(
        &folder,
        &get("person", "ada"),
        &get("password", "made-up-password"),
        &get("rights", ""),
    )?;
    let log = Arc::new(RequestLog::open(&folder)?);
    let host = match settings.get("record") {
        Some(file) => {
            let host = MadeUp::new(0);
            tokio::spawn(replay(Arc::clone(&host), recording(Path::new(file))?));
            host
        }
        None => {
            let host = MadeUp::new(get("agents", "100").parse()?);
            tokio::spawn(Arc::clone(&host).play(get("hertz", "1").parse()?));
            host
        }
    };
    if settings.contains_key("question") {
        host.ask("robot-0", "May I enter the office?", Duration::from_secs(600), false);
        host.ask("robot-0", "What is the PIN?", Duration::from_secs(600), true);
    }
    if settings.contains_key("discovered") {
        host.discover("kitchen-plug");
    }
    let tls = match (settings.get("certificate"), settings.get("key")) {
        (Some(certificate), Some(key)) => {
            let files = PageTlsFiles { certificate: certificate.into(), key: key.into() };
            Some(PageTls::open(files)?)
        }
        _ => None,
    };
    let assets = settings.get("assets").map(PathBuf::from);
    let options = PageOptions { assets, ..PageOptions::default() };
    let address: SocketAddr = get("listen", "127.0.0.1:8080").parse()?;
    let scheme = if tls.is_some() { "https" } else { "http" };
    let server = PageServer::bind(address, tls, options).await?;
    println!("{scheme}://{}", server.address().ok_or("the socket has failed")?);
    server.serve(host, accounts, Some(log)).await;
    Ok(())
}

fn people(
    folder: &Path,
    name: &str,
    password: &str,
    rights: &str,
) -> Result<Arc<Accounts>, Box<dyn std::error::Error>> {
    let words: Vec<_> = rights.split(',').filter(|word| !word.is_empty()).collect();
    let given = words.iter().filter_map(|word| PersonRight::parse(word)).collect();
    let rights = if words.is_empty() { PersonRight::ALL.into() } else { given };
    let person = PersonRecord {
        name: PersonName::new(name)?,
        rights,
        password: Some(StoredPassword::hash(password, PasswordCost::FOR_TESTS)?),
        tokens: Vec::new(),
        screen: None,
    };
    let path = folder.join("people.toml");
    PeopleFile::new(&path).change(|people| people.add(person))?;
    Ok(Arc::new(Accounts::open_with(path, PasswordCost::FOR_TESTS)?))
}

fn recording(file: &Path) -> Result<Vec<Recorded>, Box<dyn std::error::Error>> {
    let text = std::fs::read_to_string(file)?;
    let lines = text.lines().skip(1).filter_map(|line| serde_json::from_str(line).ok());
    let mut recorded: Vec<Recorded> = lines.collect();
    recorded.sort_by_key(|recorded| recorded.at_ms);
    Ok(recorded)
}

/// Plays a recording at the speed at which it was made, as if it happened now.
async fn replay(host: Arc<MadeUp>, recording: Vec<Recorded>) {
    let began = tokio::time::Instant::now();
    for Recorded { at_ms, message } in recording {
        tokio::time::sleep_until(began + Duration::from_millis(at_ms)).await;
        host.observe(made_up::now(), vec![ViewEvent::Message(Box::new(message))]);
    }
}
