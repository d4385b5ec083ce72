//! Traces of goals: real daemons, a stand-in of a collector that reads what it is sent, and a
//! collector that is not ours.

use std::net::TcpListener;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::Receiver;
use std::time::Instant;

use serde_json::Value;

use crate::support::http_receiver::{ReceivedRequest, received};
use crate::support::left_out::left_out;
use crate::support::{Office, PATIENCE, lab, lines};

const THERMOMETER: &str = "[[agent]]\nname = \"thermometer-1\"\nplugin = \"temperature-sensor\"\n\n\
    [agent.config]\nlocation = \"office1\"\n\n";

const GOAL: &str = "(known-temperature office1)";

/// An office with traces for the collector at this port.
fn office(mode: &str, port: u16) -> Office {
    let traces = format!(
        "[[agent]]\nname = \"traces\"\nplugin = \"traces\"\n\n[agent.config]\n\
         endpoint = \"http://127.0.0.1:{port}\"\n\n"
    );
    let office = Office::new();
    let file = office.write("lab.toml", &(lab(mode) + THERMOMETER + &traces));
    let mut office = office.with_file(file);
    office.up_alone(&[]);
    office.await_devices(1);
    office
}

/// What the stand-in of a collector answers.
const ACCEPTED: &str =
    "HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: 2\r\n\r\n{}";

fn spans_of(body: &Value) -> Vec<Value> {
    let scopes = &body["resourceSpans"][0]["scopeSpans"];
    scopes[0]["spans"].as_array().cloned().unwrap_or_default()
}

/// Waits for the span of the goal, and returns all spans of its trace.
fn await_goal(told: &Receiver<ReceivedRequest>) -> (Value, Vec<Value>) {
    let deadline = Instant::now() + PATIENCE;
    let mut spans: Vec<Value> = Vec::new();
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        let request = told.recv_timeout(left);
        let ReceivedRequest { head, body, .. } =
            request.unwrap_or_else(|_| panic!("no goal in {spans:?}"));
        assert_eq!(head.first().map(String::as_str), Some("post /v1/traces http/1.1"));
        assert!(head.contains(&"content-type: application/json".to_owned()), "{head:?}");
        spans.extend(spans_of(&body));
        let is_it =
            |span: &&Value| span["name"] == "goal" && attribute(span, "althing.goal") == GOAL;
        if let Some(goal) = spans.iter().find(is_it).cloned() {
            let of_it = spans.into_iter().filter(|span| span["traceId"] == goal["traceId"]);
            return (body["resourceSpans"][0]["resource"].clone(), of_it.collect());
        }
    }
}

fn attribute(of: &Value, name: &str) -> Value {
    let attributes = of["attributes"].as_array().into_iter().flatten();
    let found = attributes.into_iter().find(|attribute| attribute["key"] == name);
    found.map(|attribute| attribute["value"]["stringValue"].clone()).unwrap_or_default()
}

#[track_caller]
fn named<'s>(spans: &'s [Value], name: &str) -> &'s Value {
    let found =
        spans.iter().find(|span| span["name"].as_str().is_some_and(|it| it.starts_with(name)));
    found.unwrap_or_else(|| panic!("{name}: {spans:?}"))
}

#[test]
fn a_goal_becomes_a_trace_in_both_flows() {
    for (mode, planning) in [("decentralized", "call for proposals"), ("centralized", "plan")] {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let port = listener.local_addr().expect("an address").port();
        let told = received(listener, ACCEPTED);
        let office = office(mode, port);
        let (code, said) = office.ask(&["goal", GOAL]);
        assert_eq!(code, Some(0), "{said}");
        let (resource, spans) = await_goal(&told);
        assert_eq!(attribute(&resource, "service.name"), "althing");
        assert_eq!(attribute(&resource, "service.namespace"), "lab");
        let (goal, execution) = (named(&spans, "goal"), named(&spans, "execute plan"));
        let (action, planned) =
            (named(&spans, "action report-temperature"), named(&spans, planning));
        assert_eq!(goal["parentSpanId"], Value::Null, "{goal}");
        assert_eq!(planned["parentSpanId"], goal["spanId"], "{planned}");
        assert_eq!(execution["parentSpanId"], goal["spanId"], "{execution}");
        assert_eq!(action["parentSpanId"], execution["spanId"], "{action}");
        assert_eq!(attribute(action, "althing.agent"), "thermometer-1", "{action}");
        if mode == "decentralized" {
            let bid = named(&spans, "bid");
            assert_eq!(bid["parentSpanId"], planned["spanId"], "{bid}");
            assert_eq!(attribute(bid, "althing.agent"), "thermometer-1", "{bid}");
        }
        for span in &spans {
            assert_eq!(span["status"]["code"], 1, "all was done: {span}");
            let time = |name: &str| span[name].as_str().and_then(|it| it.parse::<u64>().ok());
            assert!(time("startTimeUnixNano") <= time("endTimeUnixNano"), "{span}");
        }
    }
}

#[test]
fn a_collector_that_is_away_delays_no_goal_and_gets_the_spans_later() {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address");
    drop(listener);
    let office = office("decentralized", address.port());
    let (code, said) = office.ask(&["goal", GOAL]);
    assert_eq!(code, Some(0), "{said}");
    // The kernel does not give the port to another process soon.
    let told = received(TcpListener::bind(address).expect("the same port"), ACCEPTED);
    let (_, spans) = await_goal(&told);
    named(&spans, "action report-temperature");
}

#[test]
fn an_unsafe_address_is_refused_by_check() {
    let office = Office::new();
    let entry = "[[agent]]\nname = \"traces\"\nplugin = \"traces\"\n\n[agent.config]\n\
        endpoint = \"http://10.0.0.9:4318\"\n";
    let file = office.write("lab.toml", &(lab("decentralized") + entry)).display().to_string();
    let checked = office.run(&["check", &file]);
    let said = crate::support::stderr(&checked);
    assert_eq!(checked.status.code(), Some(33), "{said}");
    assert!(said.contains("on this machine only"), "{said}");
}

/// Ends a process with the test.
struct Ends(Child);

impl Drop for Ends {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Returns the program of the collector Rotel, which comes with the Python package `rotel`.
fn rotel() -> Option<PathBuf> {
    let script = "import os, rotel; print(os.path.dirname(rotel.__file__))";
    let found = Command::new("python3").args(["-c", script]).output().ok()?;
    let folder = String::from_utf8(found.stdout).ok()?;
    let program = PathBuf::from(folder.trim()).join("rotel-agent");
    program.is_file().then_some(program)
}

#[test]
fn a_collector_that_is_not_ours_reads_the_spans() {
    let Some(program) = rotel() else {
        return left_out("there is no collector: pip install rotel");
    };
    let free = || {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        listener.local_addr().expect("an address").port()
    };
    let (http, grpc) = (free(), free());
    let folder = tempfile::tempdir().expect("a folder");
    let mut command = Command::new(program);
    command
        .args(["start", "--exporter", "blackhole", "--debug-log", "traces"])
        .args(["--debug-log-verbosity", "detailed", "--pid-file"])
        .arg(folder.path().join("pid"))
        .args(["--otlp-http-endpoint", &format!("127.0.0.1:{http}")])
        .args(["--otlp-grpc-endpoint", &format!("127.0.0.1:{grpc}")])
        .stdout(Stdio::piped())
        .stderr(Stdio::null());
    let mut collector = Ends(command.spawn().expect("it can be started"));
    let printed = lines(&mut collector.0);
    let office = office("decentralized", http);
    let (code, said) = office.ask(&["goal", GOAL]);
    assert_eq!(code, Some(0), "{said}");
    let wanted =
        ["service.name: Str(althing)", "Name           : goal", "action report-temperature"];
    let mut missing = wanted.to_vec();
    let deadline = Instant::now() + PATIENCE;
    while !missing.is_empty() {
        let left = deadline.saturating_duration_since(Instant::now());
        let line = printed.recv_timeout(left).unwrap_or_else(|_| panic!("no {missing:?}"));
        missing.retain(|part| !line.contains(part));
    }
}
