//! Tests with an authority, its daemons, and every way in which their messages can be wrong.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::time::{Duration, SystemTime};

use acl::EcosystemId;

use super::*;

const KEY: &str = "althing/office/in/pi/robot/request";
const PLENTY: u32 = 1_000_000;

/// Incarnation of the daemon that receives messages in these tests.
const HERE: u64 = 77;

struct House {
    _temporary: tempfile::TempDir,
    folder: CredentialFolder,
    authority: Authority,
}

fn daemon(name: &str) -> DaemonId {
    DaemonId::new(name).expect("a name")
}

fn house() -> House {
    let temporary = tempfile::tempdir().expect("a folder");
    let folder = CredentialFolder::new(temporary.path().join("keys"));
    let office = EcosystemId::new("office").expect("a name");
    let authority = Authority::create(&folder, &office, AUTHORITY_DAYS).expect("a new folder");
    House { _temporary: temporary, folder, authority }
}

impl House {
    fn identity(&self, name: &str) -> DaemonIdentity {
        self.authority.issue(&daemon(name), &[], DAEMON_DAYS).expect("a name");
        let trust = Trust::read(&self.folder).expect("just made");
        DaemonIdentity::read(&self.folder, &daemon(name), &trust).expect("just made")
    }

    fn verifier(&self) -> Verifier {
        Verifier::new(Trust::read(&self.folder).expect("just made"), PLENTY)
    }
}

fn sealed<'s>(key_expr: &'s str, payload: &'s [u8], seal: &'s [u8]) -> SealedMessage<'s> {
    let channel = SealChannel::Message;
    SealedMessage {
        channel,
        key_expr,
        payload,
        seal: Some(seal),
        nonce: None,
        only_sender: None,
        receiver_incarnation: HERE,
    }
}

#[track_caller]
fn refused(
    verifier: &Verifier,
    sealed: SealedMessage<'_>,
    why: DistrustReason,
    whose: Option<&str>,
) {
    let error = verifier.open(sealed).expect_err("not to be believed");
    assert_eq!(error, (why, whose.map(str::to_owned)));
}

#[test]
fn a_sealed_message_is_accepted_once() {
    let house = house();
    let (pi, verifier) = (house.identity("pi"), house.verifier());
    let seal = pi.seal(SealChannel::Message, KEY, b"go", Some(HERE));
    let verified = verifier.open(sealed(KEY, b"go", &seal)).expect("it is true");
    assert_eq!(verified, VerifiedOrigin { sender: daemon("pi"), signing_daemon: daemon("pi") });
    refused(&verifier, sealed(KEY, b"go", &seal), DistrustReason::Replayed, Some("pi"));
}

/// A replay of another daemon's messages must not use up that daemon's rate limit.
#[test]
fn a_replay_does_not_use_up_the_rate_limit_of_its_sender() {
    let house = house();
    let pi = house.identity("pi");
    let verifier = Verifier::new(Trust::read(&house.folder).expect("just made"), 2);
    let say = || pi.seal(SealChannel::Message, KEY, b"go", Some(HERE));
    let (recorded, late) = (say(), pi.seal(SealChannel::Message, KEY, b"go", Some(HERE - 1)));
    assert!(verifier.open(sealed(KEY, b"go", &recorded)).is_ok());
    for _ in 0..100 {
        refused(&verifier, sealed(KEY, b"go", &recorded), DistrustReason::Replayed, Some("pi"));
        refused(&verifier, sealed(KEY, b"go", &late), DistrustReason::NotSynced, Some("pi"));
    }
    assert!(verifier.open(sealed(KEY, b"go", &say())).is_ok(), "of a burst of four");
    assert_eq!(verifier.take_permits(&daemon("pi"), 5), 2, "what is said together is charged");
    refused(&verifier, sealed(KEY, b"go", &say()), DistrustReason::Flooded, Some("pi"));
}

#[test]
fn a_recording_from_before_the_receiver_started_is_rejected() {
    let house = house();
    let (pi, verifier) = (house.identity("pi"), house.verifier());
    let beat = |seal: &[u8]| {
        let sealed = SealedMessage { channel: SealChannel::AgentState, ..sealed(KEY, b"go", seal) };
        verifier.open(sealed).map_err(|(why, _)| why)
    };
    let recorded = pi.seal(SealChannel::AgentState, KEY, b"go", None);
    assert_eq!(beat(&recorded), Err(DistrustReason::NotSynced));
    let verified = VerifiedOrigin { sender: daemon("pi"), signing_daemon: daemon("pi") };
    verifier.record_reply(&verified, pi.sequence_state());
    assert_eq!(verifier.incarnation(&daemon("pi")), Some(pi.sequence_state().incarnation));
    assert_eq!(beat(&recorded), Err(DistrustReason::NotSynced), "it may have been on its way");
    let said = pi.seal(SealChannel::AgentState, KEY, b"go", None);
    assert_eq!(beat(&said), Ok(verified));
    assert_eq!(beat(&said), Err(DistrustReason::Replayed));

    let seal = pi.seal(SealChannel::Message, KEY, b"go", Some(HERE - 1));
    // The sender may not have noticed yet that this is another incarnation.
    refused(&verifier, sealed(KEY, b"go", &seal), DistrustReason::NotSynced, Some("pi"));
    let seal = pi.seal(SealChannel::Message, KEY, b"go", Some(HERE));
    assert!(verifier.open(sealed(KEY, b"go", &seal)).is_ok());
}

#[test]
fn every_change_of_a_message_is_detected() {
    let house = house();
    let (pi, verifier) = (house.identity("pi"), house.verifier());
    let seal = pi.seal(SealChannel::Message, KEY, b"go", Some(HERE));
    refused(&verifier, sealed(KEY, b"stop", &seal), DistrustReason::Forged, Some("pi"));
    let elsewhere = "althing/office/in/pi/door/request";
    refused(&verifier, sealed(elsewhere, b"go", &seal), DistrustReason::Forged, Some("pi"));
    let beat = SealedMessage { channel: SealChannel::AgentState, ..sealed(KEY, b"go", &seal) };
    refused(&verifier, beat, DistrustReason::Forged, Some("pi"));
    for index in 0..seal.len() {
        let mut seal = seal.clone();
        seal[index] ^= 1;
        assert!(verifier.open(sealed(KEY, b"go", &seal)).is_err(), "byte {index}");
    }
    for length in 0..seal.len() {
        assert!(verifier.open(sealed(KEY, b"go", &seal[..length])).is_err(), "{length} bytes");
    }
    let bare = SealedMessage { seal: None, ..sealed(KEY, b"go", &[]) };
    refused(&verifier, bare, DistrustReason::Unsigned, None);
    refused(&verifier, sealed(KEY, b"go", &[0xff; 300]), DistrustReason::Malformed, None);
    assert!(verifier.open(sealed(KEY, b"go", &seal)).is_ok(), "none of that has hurt the true one");
}

#[test]
fn an_answer_is_bound_to_one_question() {
    let house = house();
    let (pi, verifier) = (house.identity("pi"), house.verifier());
    let (mine, other) = (nonce().expect("random"), nonce().expect("random"));
    let seal = pi.seal_answer(KEY, b"yes", &mine);
    let answer = SealedMessage { channel: SealChannel::Answer, ..sealed(KEY, b"yes", &seal) };
    assert!(verifier.open(SealedMessage { nonce: Some(&mine), ..answer }).is_ok());
    refused(
        &verifier,
        SealedMessage { nonce: Some(&other), ..answer },
        DistrustReason::Forged,
        Some("pi"),
    );
    refused(&verifier, answer, DistrustReason::Forged, Some("pi"));
}

#[test]
fn a_daemon_of_another_authority_is_rejected() {
    let (house, other) = (house(), self::house());
    let (stranger, verifier) = (other.identity("pi"), house.verifier());
    let seal = stranger.seal(SealChannel::Message, KEY, b"go", Some(HERE));
    refused(&verifier, sealed(KEY, b"go", &seal), DistrustReason::Stranger, Some("pi"));
    let own = fs::copy(other.folder.authority(), house.folder.authority());
    own.expect("an attacker does not get this far");
    let trust = Trust::read(&house.folder).expect("a certificate");
    assert!(DaemonIdentity::read(&house.folder, &daemon("pi"), &trust).is_err());
}

#[test]
fn the_authority_itself_is_no_daemon() {
    let house = house();
    let trust = Trust::read(&house.folder).expect("just made");
    let authority = house.authority.certificate();
    assert_eq!(trust.check(authority, SystemTime::now()), Err(DistrustReason::Stranger));
}

#[test]
fn a_guest_sends_under_its_hosts_name_only() {
    let house = house();
    let verifier = house.verifier();
    let name = daemon("pi").guest("cli-7").expect("short");
    let guest = house.identity("pi").for_guest(name.clone());
    let seal = guest.seal(SealChannel::Message, KEY, b"go", Some(HERE));
    let verified = verifier.open(sealed(KEY, b"go", &seal)).expect("it is true");
    assert_eq!(verified, VerifiedOrigin { sender: name, signing_daemon: daemon("pi") });
    for other in ["robot-pi", "robot-pi--cli-7", "pi-"] {
        let impostor = house.identity("pi").for_guest(daemon(other));
        let seal = impostor.seal(SealChannel::Message, KEY, b"go", Some(HERE));
        refused(&verifier, sealed(KEY, b"go", &seal), DistrustReason::Impostor, Some(other));
    }
}

#[test]
fn a_restricted_key_accepts_only_its_sender() {
    let house = house();
    let (pi, verifier) = (house.identity("pi"), house.verifier());
    let seal = pi.seal(SealChannel::AgentState, KEY, b"go", None);
    let beat = SealedMessage { channel: SealChannel::AgentState, ..sealed(KEY, b"go", &seal) };
    refused(
        &verifier,
        SealedMessage { only_sender: Some("other"), ..beat },
        DistrustReason::Impostor,
        Some("pi"),
    );
    refused(
        &verifier,
        SealedMessage { only_sender: Some("pi"), ..beat },
        DistrustReason::NotSynced,
        Some("pi"),
    );
}

#[test]
fn a_certificate_expires() {
    let house = house();
    let made = house.authority.issue(&daemon("pi"), &[], 30).expect("a name");
    let trust = Trust::read(&house.folder).expect("just made");
    let now = SystemTime::now();
    let day = Duration::from_secs(24 * 3_600);
    for (then, expected) in [
        (now, Ok(())),
        (now + 29 * day, Ok(())),
        (now + 31 * day, Err(DistrustReason::Expired)),
        (now - 2 * day, Err(DistrustReason::Expired)),
    ] {
        assert_eq!(trust.check(&made, then), expected, "{then:?}");
    }
    assert_eq!(made.remaining(now).as_secs().div_ceil(24 * 3_600), 30);
    assert_eq!(made.remaining(now + 31 * day), Duration::ZERO);
}

#[test]
fn a_revoked_daemon_is_rejected_until_it_has_a_new_certificate() {
    let house = house();
    let (pi, other) = (house.identity("pi"), house.identity("other"));
    let verifier = house.verifier();
    let seal = pi.seal(SealChannel::Message, KEY, b"go", Some(HERE));
    assert!(verifier.open(sealed(KEY, b"go", &seal)).is_ok());

    assert_eq!(house.authority.revoke(&daemon("pi")).expect("it has one"), 1);
    assert!(verifier.reread_revocations().expect("just written"));

    let seal = pi.seal(SealChannel::Message, KEY, b"go", Some(HERE));
    refused(&verifier, sealed(KEY, b"go", &seal), DistrustReason::Revoked, Some("pi"));
    let seal = other.seal(SealChannel::Message, KEY, b"go", Some(HERE));
    assert!(verifier.open(sealed(KEY, b"go", &seal)).is_ok());
    assert!(house.verifier().revocations().is_some(), "a new incarnation knows it from the start");

    let anew = house.identity("pi");
    let seal = anew.seal(SealChannel::Message, KEY, b"go", Some(HERE));
    assert!(verifier.open(sealed(KEY, b"go", &seal)).is_ok());
    assert_eq!(house.authority.revoke(&daemon("pi")).expect("it has two"), 1, "one is new");
    assert_eq!(house.authority.revoke(&daemon("pi")).expect("it has two"), 0);
    let unknown = house.authority.revoke(&daemon("po")).expect_err("nobody").to_string();
    assert!(unknown.ends_with("has given it no certificate; it has given some to other, pi"));
}

#[test]
fn a_list_of_revocations_needs_a_signature_and_a_greater_number() {
    let (house, other) = (house(), self::house());
    let (_pi, _theirs) = (house.identity("pi"), other.identity("pi"));
    let verifier = house.verifier();
    house.authority.revoke(&daemon("pi")).expect("it has one");
    let first = house.verifier().revocations().expect("just made");
    house.authority.revoke(&daemon("pi")).expect("it has one");
    let second = house.verifier().revocations().expect("just made");
    other.authority.revoke(&daemon("pi")).expect("it has one");
    let foreign = other.verifier().revocations().expect("just made");

    assert_eq!(verifier.take_revocations(&foreign), None);
    assert_eq!(verifier.take_revocations(b"garbage"), None);
    assert_eq!(verifier.take_revocations(&second), Some(true));
    assert_eq!(verifier.take_revocations(&second), Some(false));
    assert_eq!(verifier.take_revocations(&first), Some(false), "an older list is not taken");
    let mut changed = second;
    let last = changed.len() - 1;
    changed[last] ^= 1;
    assert_eq!(verifier.take_revocations(&changed), None);

    fs::remove_file(house.folder.revocations()).expect("it was there");
    verifier.store_revocations().expect("the folder is ours");
    assert_eq!(house.verifier().revocations(), verifier.revocations());
}

#[test]
fn a_flooding_sender_is_limited_and_others_are_not() {
    let house = house();
    let (pi, other) = (house.identity("pi"), house.identity("other"));
    let verifier = Verifier::new(Trust::read(&house.folder).expect("just made"), 10);
    let open = |identity: &DaemonIdentity| {
        let seal = identity.seal(SealChannel::Message, KEY, b"go", Some(HERE));
        verifier.open(sealed(KEY, b"go", &seal))
    };
    let flood: Vec<_> = (0..100).map(|_| open(&pi)).collect();
    let passed = flood.iter().filter(|each| each.is_ok()).count();
    assert!((20..100).contains(&passed), "{passed}");
    assert!(flood.contains(&Err((DistrustReason::Flooded, Some("pi".to_owned())))));
    assert!(open(&other).is_ok());
}

#[test]
fn a_key_that_others_can_read_is_refused_with_the_remedy() {
    let house = house();
    drop(house.identity("pi"));
    for key in [house.folder.key(&daemon("pi")), house.folder.authority_key()] {
        let mode = |path| fs::metadata(path).expect("made").permissions().mode() & 0o777;
        assert_eq!(mode(&key), 0o600);
        fs::set_permissions(&key, fs::Permissions::from_mode(0o640)).expect("ours");
    }
    let trust = Trust::read(&house.folder).expect("just made");
    let key = house.folder.key(&daemon("pi"));
    let error = DaemonIdentity::read(&house.folder, &daemon("pi"), &trust).expect_err("loose");
    let error = error.to_string();
    assert!(error.contains("mode 640") && error.ends_with(&format!("chmod 600 {}", key.display())));
    assert!(matches!(Authority::open(&house.folder), Err(CredentialError::Loose { .. })));
}

/// A user that can replace the authority's certificate decides which certificates are trusted.
#[test]
fn a_world_writable_authority_is_not_trusted() {
    let house = house();
    let allow = |path: &std::path::Path, mode| {
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).expect("allowed");
        Trust::read(&house.folder).map(drop)
    };
    let (file, folder) = (house.folder.authority(), house.folder.path().to_owned());
    for (path, mode, is_trusted) in
        [(&file, 0o644, true), (&file, 0o646, false), (&file, 0o644, true), (&folder, 0o777, false)]
    {
        assert_eq!(allow(path, mode).is_ok(), is_trusted, "{} {mode:o}", path.display());
    }
    let refused = allow(&folder, 0o707).expect_err("anybody's").to_string();
    assert!(refused.contains("(mode 707); forbid that: chmod o-w"), "{refused}");
    assert!(allow(&folder, 0o1777).is_ok(), "sticky");
}

#[test]
fn errors_name_the_missing_or_mistaken_item() {
    let house = house();
    let trust = Trust::read(&house.folder).expect("just made");
    let missing = DaemonIdentity::read(&house.folder, &daemon("pi"), &trust).expect_err("none yet");
    assert!(missing.to_string().contains("`althing cert daemon pi`"), "{missing}");
    let office = EcosystemId::new("office").expect("a name");
    let again = Authority::create(&house.folder, &office, 1).expect_err("there is one");
    assert!(matches!(again, CredentialError::Exists { .. }), "{again}");
    for name in ["a--b", "authority", "revoked", &"x".repeat(41)] {
        let refused = house.authority.issue(&daemon(name), &[], 1).expect_err(name);
        assert!(matches!(refused, CredentialError::Name(_)), "{refused}");
    }
    for host in ["", "a b", "-a", "a..b", "http://a"] {
        let refused = house.authority.issue(&daemon("pi"), &[host.to_owned()], 1).expect_err(host);
        assert!(matches!(refused, CredentialError::Host(_)), "{refused}");
    }
    drop(house.identity("pi"));
    drop(house.identity("other"));
    fs::copy(house.folder.certificate(&daemon("pi")), house.folder.certificate(&daemon("other")))
        .expect("ours");
    let mixed =
        DaemonIdentity::read(&house.folder, &daemon("other"), &trust).expect_err("mixed up");
    assert!(mixed.to_string().contains("it is not the certificate of"), "{mixed}");
    assert_eq!(house.folder.daemons(), ["other", "pi"].map(daemon));
}

#[test]
fn a_certificate_names_its_daemon_and_hosts() {
    let house = house();
    let hosts = ["192.168.1.7".to_owned(), "fe80::1".to_owned(), "pi.example.org".to_owned()];
    let made = house.authority.issue(&daemon("pi"), &hosts, 10).expect("good hosts");
    assert_eq!(made.daemon(), Some(daemon("pi")));
    assert_eq!(made.hosts, ["pi", "pi.local", "192.168.1.7", "fe80::1", "pi.example.org"]);
    assert_eq!(house.authority.issued(), [made]);
}

#[test]
fn debug_output_contains_no_key() {
    let house = house();
    let pi = house.identity("pi");
    let text = fs::read_to_string(house.folder.key(&daemon("pi"))).expect("made");
    let body: String = text.lines().filter(|line| !line.starts_with('-')).collect();
    let shown = format!("{pi:?} {:?} {:?}", house.authority, house.verifier());
    assert!(!shown.contains(&body) && !shown.to_lowercase().contains("secret"), "{shown}");
}
