//! Measures what pages cost, beside the targets: the time from an event in the building to a page,
//! the share of a core per open page, what a hundred pages hold that do not read, and the rows of a
//! thousand agents.
//!
//! ```text
//! cargo bench -p web-page --bench page
//! ```
//!
//! The server runs in this process, and pages that read run in another one, so that only the
//! server's time is counted. The ecosystem is made up; what it costs without a page is measured
//! first, and subtracted.

#[path = "../examples/made_up/mod.rs"]
mod made_up;

use std::io::{Read as _, Write as _};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

use accounts::{
    Accounts, PasswordCost, PeopleFile, PersonName, PersonRecord, PersonRight, StoredToken,
};
use made_up::MadeUp;
use peak_alloc::PeakAlloc;
use tokio::runtime::Runtime;
use web_page::{PageOptions, PageServer};

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Topics of a page with much to show: the overview with its lists.
const TOPICS: &str = "overview,goals,agents,facts,questions,activity,stops";

/// Pages that are open while the cost of one is measured.
const PAGES: usize = 20;

/// Times that the cost is measured, and the part of a window that each measurement takes.
const COST_ROUNDS: usize = 5;
const COST_PARTS: u32 = 3;

/// Pages that do not read.
const STUCK: usize = 100;

/// How long a page waits for an event before the measurement has failed.
const SEEN_WITHIN: Duration = Duration::from_secs(10);

/// Targets: milliseconds from an event to a page, and the share of a core per page.
const LATENCY_AIM_MS: f64 = 100.0;
const CORE_AIM: f64 = 0.01;

struct Served {
    _runtime: Runtime,
    address: SocketAddr,
    token: String,
    host: Arc<MadeUp>,
    _folder: tempfile::TempDir,
}

fn main() {
    let arguments: Vec<_> = std::env::args().collect();
    if let [_, mode, address, token, pages] = arguments.as_slice()
        && mode == "--read"
    {
        return read_for_ever(address, token, pages.parse().expect("a number"));
    }
    // Without `--bench`, Cargo only checks that the benchmark runs.
    let is_measured = arguments.iter().any(|argument| argument == "--bench");
    let (events, window) =
        if is_measured { (500, Duration::from_secs(15)) } else { (3, Duration::from_millis(300)) };
    let served = Served::new(100);
    latencies(&served, events, "100 devices at 1 Hz, one page");
    cost(&served, window, "100 devices at 1 Hz");
    let before = ALLOCATOR.current_usage();
    let stuck: Vec<_> = (0..STUCK).map(|_| served.open(TOPICS)).collect();
    storm(&served, window);
    let held = ALLOCATOR.current_usage().saturating_sub(before) as f64;
    println!("{STUCK} pages that do not read: {:.1} KiB each", held / STUCK as f64 / 1_024.0);
    latencies(&served, events, "with 100 pages that do not read");
    drop(stuck);
    drop(served);
    let served = Served::new(1_000);
    rows(&served, window);
    cost(&served, window, "1,000 agents at 1 Hz");
}

impl Served {
    fn new(agents: usize) -> Served {
        let runtime = Runtime::new().expect("a runtime");
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("people.toml");
        let name = |text| PersonName::new(text).expect("a name");
        let (token, stored) =
            StoredToken::make(name("program"), SystemTime::now()).expect("random bytes");
        let ada = PersonRecord {
            name: name("ada"),
            rights: PersonRight::ALL.into(),
            password: None,
            tokens: vec![stored],
            screen: None,
        };
        PeopleFile::new(&path).change(|people| people.add(ada)).expect("written");
        let accounts = Accounts::open_with(path, PasswordCost::FOR_TESTS).expect("readable");
        let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let bound = PageServer::bind(any, None, PageOptions::default());
        let server = runtime.block_on(bound).expect("a free port");
        let address = server.address().expect("a socket");
        let host = MadeUp::new(agents);
        runtime.spawn(Arc::clone(&host).play_spread(1.0));
        runtime.spawn(server.serve(Arc::<MadeUp>::clone(&host), Arc::new(accounts), None));
        Served { _runtime: runtime, address, token, host, _folder: folder }
    }

    /// Opens a page, and reads nothing.
    fn open(&self, topics: &str) -> TcpStream {
        open(&self.address.to_string(), &self.token, topics)
    }

    /// Starts a process with pages that read.
    fn readers(&self, pages: usize) -> Child {
        let program = std::env::current_exe().expect("this program");
        let (address, pages) = (self.address.to_string(), pages.to_string());
        Command::new(program)
            .args(["--read", &address, &self.token, &pages])
            .stdout(Stdio::null())
            .spawn()
            .expect("it starts")
    }
}

fn open(address: &str, token: &str, topics: &str) -> TcpStream {
    let mut stream = TcpStream::connect(address).expect("it listens");
    let request = format!(
        "GET /api/events?topics={topics} HTTP/1.1\r\nHost: {address}\r\nAuthorization: Bearer {token}\r\n\r\n"
    );
    stream.write_all(request.as_bytes()).expect("it is connected");
    stream
}

fn read_for_ever(address: &str, token: &str, pages: usize) {
    let threads: Vec<_> = (0..pages)
        .map(|_| open(address, token, TOPICS))
        .map(|mut stream| {
            std::thread::spawn(move || {
                let mut buffer = vec![0; 64 << 10];
                while stream.read(&mut buffer).is_ok_and(|read| read > 0) {}
            })
        })
        .collect();
    threads.into_iter().for_each(|thread| drop(thread.join()));
}

/// Measures the time from an event in the building to the bytes at a page.
fn latencies(served: &Served, events: usize, what: &str) {
    let mut stream = served.open(TOPICS);
    stream.set_read_timeout(Some(SEEN_WITHIN)).expect("it can be set");
    let mut times = Vec::new();
    let mut buffer = vec![0; 256 << 10];
    for number in 0..events {
        let value = 100_000 + number as u64;
        let wanted = format!("\"value\":{value}.0");
        // Not in step with the heartbeats.
        std::thread::sleep(Duration::from_millis(37 + number as u64 % 53));
        let began = Instant::now();
        served.host.set_value(1, value);
        let mut seen = String::new();
        while !seen.contains(&wanted) {
            let read = stream.read(&mut buffer).expect("events come");
            assert!(read > 0, "the stream has ended");
            seen.push_str(&String::from_utf8_lossy(&buffer[..read]));
        }
        times.push(began.elapsed().as_secs_f64() * 1_000.0);
    }
    times.sort_by(f64::total_cmp);
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
    println!(
        "event to page, {what}: p50 {:.1} ms, p99 {:.1} ms, worst {:.1} ms of {events} (aim: p99 {LATENCY_AIM_MS:.0})",
        at(0.5),
        at(0.99),
        at(1.0),
    );
}

/// Changes everything as often as pages are sent anything, until sockets that are not read are full.
fn storm(served: &Served, window: Duration) {
    let began = Instant::now();
    let mut value = 0;
    while began.elapsed() < window {
        value += 1;
        (0..100).for_each(|agent| served.host.set_value(agent, value));
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Measures the share of a core that an open page takes: several times in turns without a page, with
/// one and with many, because a machine with other work is fast and slow by turns.
fn cost(served: &Served, window: Duration, what: &str) {
    let window = window / COST_PARTS;
    let share = |pages: usize| {
        let mut readers = (pages > 0).then(|| served.readers(pages));
        std::thread::sleep(window / 5);
        let (began, before) = (Instant::now(), cpu_seconds());
        std::thread::sleep(window);
        let share = (cpu_seconds() - before) / began.elapsed().as_secs_f64();
        if let Some(readers) = &mut readers {
            readers.kill().and_then(|()| readers.wait()).expect("it runs");
        }
        share * 100.0
    };
    let rounds = (0..COST_ROUNDS).map(|_| [0, 1, PAGES].map(share));
    let rounds: Vec<[f64; 3]> = rounds.collect();
    let median = |of: &dyn Fn(&[f64; 3]) -> f64| {
        let mut values: Vec<_> = rounds.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    println!(
        "cost, {what}, medians of {COST_ROUNDS}: {:.2} % of a core without a page, {:.2} % with \
         one, {:.2} % with {PAGES}: {:.2} % for the first, {:.2} % for each further one (aim: \
         {:.0} %)",
        median(&|[without, ..]| *without),
        median(&|[_, one, _]| *one),
        median(&|[.., many]| *many),
        median(&|[without, one, _]| one - without),
        median(&|[_, one, many]| (many - one) / (PAGES - 1) as f64),
        CORE_AIM * 100.0,
    );
}

/// Returns the processor time of this process so far, in seconds.
fn cpu_seconds() -> f64 {
    // The times of user and system are fields 14 and 15, in hundredths of seconds (proc_pid_stat(5)).
    let stat = std::fs::read_to_string("/proc/self/stat").expect("Linux");
    let after_name = stat.rsplit_once(')').expect("a name").1;
    let fields: Vec<_> = after_name.split_whitespace().collect();
    let ticks = |index: usize| fields[index].parse::<f64>().expect("a number");
    (ticks(11) + ticks(12)) / 100.0
}

/// Counts the rows and bytes that a page is sent.
fn rows(served: &Served, window: Duration) {
    let mut stream = served.open(TOPICS);
    stream.set_read_timeout(Some(SEEN_WITHIN)).expect("it can be set");
    let mut buffer = vec![0; 256 << 10];
    let (mut bytes, mut rows, began) = (0, 0, Instant::now());
    let mut first = None;
    while began.elapsed() < window {
        let read = stream.read(&mut buffer).expect("events come");
        let text = String::from_utf8_lossy(&buffer[..read]);
        bytes += read;
        rows += text.matches("\":{\"agent\":").count() + text.matches("\":{\"fact\":").count();
        if first.is_none() && rows >= 2_000 {
            first = Some((bytes, began.elapsed()));
        }
    }
    let (start, after) = first.unwrap_or((bytes, began.elapsed()));
    let seconds = (began.elapsed() - after).as_secs_f64().max(0.001);
    println!(
        "1,000 agents at 1 Hz: all rows within {:.0} ms ({} KiB), then {:.0} rows and {:.0} KiB per second",
        after.as_secs_f64() * 1_000.0,
        start / 1_024,
        rows.saturating_sub(2_000) as f64 / seconds,
        (bytes - start) as f64 / 1_024.0 / seconds,
    );
}
