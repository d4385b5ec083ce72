//! Tests of the `config` of the entry.

use agent::{Host, Resources};
use serde_json::{Value, json};

use super::*;

fn blueprint(config: Value, is_check: bool, folder: &Path) -> Blueprint {
    let ontology = pddl::parse_domain("(define (domain lab))").value.expect("a domain");
    let map = "(define (problem map) (:domain lab) (:init) (:goal (and)))";
    let map = pddl::parse_problem(map).value.expect("a map");
    let mut resources = Resources::default();
    resources.insert(EcosystemFolder(folder.to_owned()));
    match is_check {
        true => resources.insert(BuildCheck),
        false => resources.insert(StateFolder(folder.join("state"))),
    }
    let host = Host { resources, ..Host::new(ontology, map) };
    let id = acl::AgentId::new("notifier").expect("a name");
    Blueprint { id, driver: String::new(), config: config.into(), host: Arc::new(host) }
}

/// Checks an entry as `althing check` does: without its files.
fn checked(config: Value) -> Result<NotifierSettings, String> {
    let blueprint = blueprint(config, true, Path::new("/nowhere"));
    settings(&blueprint).map_err(|error| error.to_string())
}

fn channel(channel: Value) -> Result<NotifierChannel, String> {
    let settings = checked(json!({ "page": "https://hall-pi:8443", "to": [channel] }))?;
    Ok(settings.channels.into_iter().next().expect("one channel"))
}

fn ntfy(more: Value) -> Result<NotifierChannel, String> {
    let mut entry = json!({ "kind": "ntfy", "url": "https://ntfy.example/hall" });
    let fields = entry.as_object_mut().expect("an object");
    fields.extend(more.as_object().cloned().expect("an object"));
    channel(entry)
}

#[test]
fn every_kind_of_channel_can_be_written() {
    for (entry, name) in [
        (
            json!({ "kind": "ntfy", "url": "https://ntfy.example/hall", "token-file": "t",
                "answers": ["yes", "no"], "answer-token-file": "a" }),
            "1 (ntfy)",
        ),
        (
            json!({ "kind": "webhook", "url": "http://localhost:1/x", "secret-file": "s" }),
            "1 (webhook)",
        ),
        (
            json!({ "kind": "email", "relay": "mail.example:2525", "user": "u",
                "password-file": "p", "from": "Hall <a@b.example>", "receivers": ["c@d.example"],
                "security": "tls", "ca": "ca.pem" }),
            "1 (email)",
        ),
        (
            json!({ "kind": "web-push", "contact": "mailto:a@b.example",
                "services": ["https://push.example/", "https://*.push.example"] }),
            "1 (web-push)",
        ),
    ] {
        let channel = channel(entry).expect(name);
        assert_eq!(channel.name, name);
        assert_eq!(channel.form.page.as_deref(), Some("https://hall-pi:8443"));
        assert_eq!((channel.rules.events.len(), channel.rules.per_hour), (5, PER_HOUR));
    }
}

#[test]
fn rules_are_read() {
    let more = json!({ "events": ["stop"], "quiet": "22:00-07:00", "quiet-stops": true,
        "until": "2027-01-31", "per-hour": 5, "include-text": false });
    let NotifierChannel { rules, form, .. } = ntfy(more).expect("right");
    assert_eq!(rules.events, [NoticeEvent::Stop].into());
    assert!(rules.quiet.is_some() && rules.are_stops_quiet && form.is_discreet);
    let next_day = TimeZone::system().to_timestamp(jiff::civil::date(2027, 2, 1).at(0, 0, 0, 0));
    assert_eq!((rules.until, rules.per_hour), (next_day.ok(), 5));
    let rules = ntfy(json!({ "until": "2027-01-31T18:30" })).expect("right").rules;
    let time = TimeZone::system().to_timestamp(jiff::civil::date(2027, 1, 31).at(18, 30, 0, 0));
    assert_eq!(rules.until, time.ok());
}

#[test]
fn mistakes_are_told_with_what_would_be_right() {
    for (more, reason) in [
        (json!({ "events": [] }), "`events` is empty"),
        (json!({ "events": ["stops"] }), "unknown variant `stops`"),
        (json!({ "per-hour": 0 }), "from 1 to 1000"),
        (json!({ "quiet-stops": true }), "`quiet-stops` needs `quiet`"),
        (json!({ "until": "tomorrow" }), "2027-01-31"),
        (json!({ "answers": ["yes"] }), "`answer-token-file`"),
        (json!({ "answers": [], "answer-token-file": "a" }), "1 to 3 short texts"),
        (json!({ "answers": ["a", "b", "c", "d"], "answer-token-file": "a" }), "at most 3"),
        (json!({ "secret-file": "s" }), "`secret-file` is no key of this kind"),
        (json!({ "colour": "red" }), "unknown field `colour`"),
    ] {
        let problem = ntfy(more.clone()).err().unwrap_or_else(|| panic!("{more}"));
        assert!(problem.contains(reason), "{reason}: {problem}");
    }
    for (config, reason) in [
        (json!({}), "missing field `to`"),
        (json!({ "to": [] }), "1 to 32 channels"),
        (json!({ "gone-after": "0s", "to": [] }), "from 1s to 7days"),
        (json!({ "page": "http://hall:80", "to": [{ "kind": "ntfy" }] }), "`page = "),
        (json!({ "page": "https://hall/x", "to": [{ "kind": "ntfy" }] }), "it has a path"),
        (json!({ "to": [{ "kind": "ntfy" }] }), "channel 1 of `to` (ntfy): `url` is missing"),
    ] {
        let problem = checked(config.clone()).err().unwrap_or_else(|| panic!("{config}"));
        assert!(problem.contains(reason), "{reason}: {problem}");
    }
}

/// An address or a secret in an error would be in the log.
#[test]
fn addresses_and_secrets_are_in_no_error() {
    for entry in [
        json!({ "kind": "ntfy", "url": "ftp://ntfy.example/TOPIC" }),
        json!({ "kind": "ntfy", "url": "https://ntfy.example/a/TOPIC" }),
        json!({ "kind": "webhook", "url": "http://10.0.0.9/TOPIC", "secret-file": "s" }),
    ] {
        let problem = channel(entry.clone()).err().unwrap_or_else(|| panic!("{entry}"));
        assert!(!problem.contains("TOPIC"), "{problem}");
    }
}

#[test]
fn a_daemon_reads_the_files_and_a_check_does_not() {
    let entry = json!({ "to": [
        { "kind": "webhook", "url": "http://localhost:1/x", "secret-file": "secret" },
    ] });
    let folder = tempfile::tempdir().expect("a folder");
    assert!(checked(entry.clone()).is_ok());
    let real = || settings(&blueprint(entry.clone(), false, folder.path())).map(drop);
    let problem = real().expect_err("there is no file").to_string();
    assert!(problem.contains("secret"), "{problem}");
    let path = folder.path().join("secret");
    std::fs::write(&path, "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw\n").expect("a file");
    let mode = |mode| {
        let mode = std::os::unix::fs::PermissionsExt::from_mode(mode);
        std::fs::set_permissions(&path, mode).expect("ours");
    };
    mode(0o644);
    let problem = real().expect_err("others can read it").to_string();
    assert!(problem.contains("chmod 600") && !problem.contains("MfKQ"), "{problem}");
    mode(0o600);
    real().expect("right");
}
