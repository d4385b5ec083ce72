//! Notifications, on real daemons: a webhook in the test is told of a question, a lost goal, an
//! agent that is gone and back, a stop and its release.

use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt as _;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant, UNIX_EPOCH};

use serde_json::Value;

use crate::support::http_receiver::{ReceivedRequest, received};
use crate::support::{Office, PATIENCE, lab, stderr};

const ROBOT: &str = "[[agent]]\nname = \"turtlebot-1\"\nplugin = \"turtlebot\"\n\
    config = { start = \"corridor\", speed = 2.0 }\n\n[building]\ntime-scale = 0.02\n\n\
    [safeguards.turtlebot-1]\nmove = { confirm = true, patience = \"1min\" }\n\n";

const THERMOMETER: &str = "[[agent]]\nname = \"thermometer-1\"\nplugin = \"temperature-sensor\"\n\
    config = { location = \"office1\" }\n\n";

/// Time within which a receiver has a notice after the notifier has heard of the event.
const TOLD_WITHIN: Duration = Duration::from_secs(1);

/// The place of an entry: `text` with `daemon` as its daemon.
fn on(daemon: &str, text: &str) -> String {
    text.replace("\nplugin = ", &format!("\ndaemon = {daemon}\nplugin = "))
}

/// The entry of a notifier that tells a webhook at this port.
fn notifier(port: u16) -> String {
    format!(
        "[[agent]]\nname = \"notifier\"\nplugin = \"notifier\"\n\n[agent.config]\n\
         gone-after = \"1s\"\npage = \"https://hall:8443\"\n\n[[agent.config.to]]\n\
         kind = \"webhook\"\nurl = \"http://127.0.0.1:{port}/hook\"\nsecret-file = \"secret\"\n\n"
    )
}

/// Writes the secret of the webhook, which is for its owner only.
fn write_secret(office: &Office) {
    let path = office.write("secret", "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw\n");
    let mode = std::fs::Permissions::from_mode(0o600);
    std::fs::set_permissions(path, mode).expect("ours");
}

/// A notice that has arrived, and how long that took since the notifier heard of the event.
struct Told {
    notice: Value,
    link: Value,
    after: Duration,
}

/// What the webhook answers.
const TAKEN: &str = "HTTP/1.1 204 No Content\r\nContent-Length: 0\r\n\r\n";

/// Fails unless a request has the form of a webhook's.
#[track_caller]
fn check_head(head: &[String]) {
    assert_eq!(head.first().map(String::as_str), Some("post /hook http/1.1"));
    for header in ["webhook-id: ", "webhook-timestamp: ", "webhook-signature: v1,"] {
        assert!(head.iter().any(|line| line.starts_with(header)), "{header}: {head:?}");
    }
}

/// Waits for the next notice of this kind. Others may come before it.
#[track_caller]
fn next(told: &Receiver<ReceivedRequest>, kind: &str) -> Told {
    let deadline = Instant::now() + PATIENCE;
    let mut others = Vec::new();
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        let arrival = told.recv_timeout(left);
        let ReceivedRequest { head, at: arrived, body } =
            arrival.unwrap_or_else(|_| panic!("no {kind}: {others:?}"));
        check_head(&head);
        let now = arrived.duration_since(UNIX_EPOCH).expect("after 1970");
        let notice = body["notices"][0].clone();
        if notice["kind"] == kind {
            let at = Duration::from_millis(notice["at"].as_u64().expect("a time"));
            let after = now.saturating_sub(at);
            eprintln!("{kind}: told {after:?} after it was heard of");
            return Told { link: body["link"].clone(), notice, after };
        }
        others.push(body);
    }
}

fn listener() -> (TcpListener, u16) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = listener.local_addr().expect("an address").port();
    (listener, port)
}

#[test]
fn people_elsewhere_are_told_and_an_answer_settles_the_question() {
    let (listener, port) = listener();
    let office = Office::new();
    write_secret(&office);
    let here = lab("centralized") + &notifier(port);
    let text = on("\"here\"", &here) + &on("\"here\"", ROBOT) + &on("\"there\"", THERMOMETER);
    let file = office.write("lab.toml", &text);
    let mut office = office.with_file(file);
    let told = received(listener, TAKEN);
    office.up(&["here", "there"], &[]);
    office.await_devices(2);
    office.await_fact("(at turtlebot-1 corridor)", true);

    let mut moved = office.command(&["act", "(move turtlebot-1 corridor office1)"]);
    let moved = moved.stdout(std::process::Stdio::piped()).spawn().expect("a command");
    let question = next(&told, "question");
    assert!(question.after < TOLD_WITHIN, "{:?}", question.after);
    let text = question.notice["text"].as_str().expect("text");
    assert!(text.contains("(move turtlebot-1 corridor office1). May it?"), "{text}");
    assert_eq!(question.link, "https://hall:8443/questions");
    office.answer("May it?", "yes");
    let output = moved.wait_with_output().expect("it ends");
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stdout));

    let (code, said) = office.ask(&["goal", "(mounted-on thermometer-1 turtlebot-1)"]);
    assert_eq!(code, Some(1), "{said}");
    let lost = next(&told, "goal-lost");
    assert!(lost.after < TOLD_WITHIN, "{:?}", lost.after);
    assert_eq!(lost.notice["text"], "(mounted-on thermometer-1 turtlebot-1)");
    let id = lost.notice["goal"].as_str().expect("a conversation");
    assert_eq!(lost.link, format!("https://hall:8443/goals/{id}"));

    let (code, said) = office.ask(&["stop", "--because", "the fire alarm"]);
    assert_eq!(code, Some(0), "{said}");
    let stop = next(&told, "stop");
    assert!(stop.after < TOLD_WITHIN, "{:?}", stop.after);
    let text = stop.notice["text"].as_str().expect("text");
    assert!(text.ends_with(" stops everything: the fire alarm"), "{text}");
    let (code, said) = office.ask(&["stop", "--release"]);
    assert_eq!(code, Some(0), "{said}");
    next(&told, "release");

    office.kill("there");
    let gone = next(&told, "agent-gone");
    assert_eq!(gone.notice["agents"], serde_json::json!(["thermometer-1"]));
    assert_eq!(gone.link, "https://hall:8443/agents/thermometer-1");
    office.up(&["there"], &[]);
    assert_eq!(next(&told, "agent-back").notice["agents"][0], "thermometer-1");
    // What was told is told once.
    let more: Vec<_> = told.try_iter().collect();
    assert!(more.is_empty(), "{more:?}");
}

#[test]
fn of_two_notifiers_one_tells_and_the_other_takes_over() {
    let (listener, port) = listener();
    let office = Office::new();
    write_secret(&office);
    let text = on("\"one\"", &lab("centralized"))
        + &on("[\"one\", \"two\"]", &notifier(port))
        + &on("\"two\"", THERMOMETER);
    let text = text.replace("daemon = \"one\"", "daemon = [\"one\", \"two\"]");
    let file = office.write("lab.toml", &text);
    let mut office = office.with_file(file);
    let told = received(listener, TAKEN);
    office.up(&["one", "two"], &[]);
    office.await_devices(1);
    let (code, said) = office.ask(&["stop", "--because", "first"]);
    assert_eq!(code, Some(0), "{said}");
    let first = next(&told, "stop").notice;
    assert!(first["text"].to_string().contains("first"), "{first}");
    let more = told.try_iter().filter(|it| it.body["notices"][0]["kind"] == "stop").count();
    assert_eq!(more, 0, "one of the two has told it");
    office.kill("one");
    let (_, said) = office.ask(&["stop", "--because", "second"]);
    assert!(said.contains("thermometer-1"), "{said}");
    // The new leader repeats what the dead one may not have sent, with the same identifier.
    let second = loop {
        let notice = next(&told, "stop").notice;
        if notice["id"] != first["id"] {
            break notice;
        }
    };
    assert!(second["text"].to_string().contains("second"), "{second}");
}

#[test]
fn a_receiver_that_is_away_delays_nothing_and_is_told_later() {
    let (listener, port) = listener();
    let address = listener.local_addr().expect("an address");
    drop(listener);
    let office = Office::new();
    write_secret(&office);
    let text = lab("centralized") + THERMOMETER + &notifier(port);
    let file = office.write("lab.toml", &text);
    let mut office = office.with_file(file);
    office.up_alone(&[]);
    office.await_devices(1);
    let (code, said) = office.ask(&["stop", "--because", "a test"]);
    assert_eq!(code, Some(0), "{said}");
    // The kernel does not give the port to another process soon.
    let told = received(TcpListener::bind(address).expect("the same port"), TAKEN);
    assert!(next(&told, "stop").notice["text"].to_string().contains("a test"));
}

#[test]
fn mistakes_in_channels_are_reported_by_check_with_their_places() {
    let office = Office::new();
    let mut wrong = Vec::new();
    for (channel, complaint) in [
        ("kind = \"pigeon\"", "cannot be \"pigeon\""),
        (
            "kind = \"webhook\"\nurl = \"http://10.0.0.9/\"\nsecret-file = \"s\"",
            "this machine only",
        ),
        ("kind = \"webhook\"\nurl = \"https://a.example/\"", "`secret-file` is missing"),
        ("kind = \"ntfy\"\nurl = \"https://a.example/\"", "one topic"),
        ("kind = \"ntfy\"\nurl = \"https://a.example/t\"\nrelay = \"b\"", "`relay` is no key"),
        ("kind = \"ntfy\"\nurl = \"https://a.example/t\"\nquiet = \"22-7\"", "\"22:00-07:00\""),
        (
            "kind = \"ntfy\"\nurl = \"https://a.example/t\"\nquite = \"22:00-07:00\"",
            "no key `quite`",
        ),
        ("kind = \"ntfy\"\nurl = \"https://a.example/t\"\nuntil = \"soon\"", "2027-01-31"),
        ("kind = \"email\"\nrelay = \"mail.example\"\nfrom = \"a@b.example\"", "`receivers` needs"),
        (
            "kind = \"email\"\nrelay = \"mail.example\"\nsecurity = \"none\"\n\
             from = \"a@b.example\"\nreceivers = [\"c@d.example\"]",
            "on this machine only",
        ),
        ("kind = \"web-push\"", "`contact` must be"),
    ] {
        let entry = format!(
            "[[agent]]\nname = \"notifier\"\nplugin = \"notifier\"\n\n[[agent.config.to]]\n{channel}\n"
        );
        let file = office.write("lab.toml", &(lab("centralized") + &entry));
        let checked = office.run(&["check", &file.display().to_string()]);
        let said = stderr(&checked);
        assert_eq!(checked.status.code(), Some(33), "{channel}: {said}");
        // The lines are wrapped.
        let flat = said.split_whitespace().collect::<Vec<_>>().join(" ");
        if !flat.contains(complaint) || !said.contains("lab.toml:") {
            wrong.push(format!("{complaint}: {said}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    let right = "kind = \"web-push\"\ncontact = \"mailto:a@b.example\"\nquiet = \"22:00-07:00\"";
    let entry = format!(
        "[[agent]]\nname = \"notifier\"\nplugin = \"notifier\"\n\n[[agent.config.to]]\n{right}\n"
    );
    let file = office.write("lab.toml", &(lab("centralized") + &entry));
    let checked = office.run(&["check", &file.display().to_string()]);
    assert!(checked.status.success(), "{}", stderr(&checked));
}
