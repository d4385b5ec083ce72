//! Signing in: sessions begin and end as they should, and guessers get nowhere.

use std::fs;
use std::net::IpAddr;
use std::sync::Barrier;
use std::time::Duration;

use super::{AWAY, HOME, PASSWORD, PeopleFolder, hashed, record, start};
use crate::{
    Accounts, NewSession, PasswordCost, PersonRight, SESSION_IDLE_MAX, SESSION_LASTS,
    SignInRefusal, StoredPassword,
};

fn enter(accounts: &Accounts, who: &str) -> NewSession {
    accounts.sign_in(who, PASSWORD, HOME, start()).expect("the password is right")
}

#[test]
fn a_person_signs_in_and_out() {
    let folder = PeopleFolder::with(&["anna"]);
    let accounts = folder.accounts();
    let NewSession { secret, signed_in } = enter(&accounts, "anna");
    assert_eq!(signed_in.person.name.as_str(), "anna");
    assert!(signed_in.has_csrf(&signed_in.csrf) && !signed_in.has_csrf(""));
    assert_ne!(signed_in.csrf, secret);
    let found = accounts.session(&secret, start()).expect("a session");
    assert_eq!(found, signed_in);
    assert!(accounts.is_open(signed_in.session, start()));
    assert_eq!(accounts.session(&signed_in.csrf, start()), None);
    let mut changes = accounts.changes();
    changes.mark_unchanged();
    accounts.sign_out(&secret);
    assert!(changes.has_changed().expect("a sender"));
    assert_eq!(accounts.session(&secret, start()), None);
    assert!(!accounts.is_open(signed_in.session, start()));
}

#[test]
fn debug_output_shows_no_secret() {
    let folder = PeopleFolder::with(&["anna"]);
    let accounts = folder.accounts();
    let session = enter(&accounts, "anna");
    let shown = format!("{session:?}");
    assert!(!shown.contains(&session.secret) && !shown.contains(&session.signed_in.csrf));
}

#[test]
fn wrong_names_and_passwords_are_refused_alike() {
    let folder = PeopleFolder::with(&["anna"]);
    let mut bot = record("bot", &[]);
    bot.password = None;
    folder.add(bot);
    let accounts = folder.accounts();
    let long = "x".repeat(2_000);
    for (who, password) in [
        ("anna", "wrong"),
        ("anna", ""),
        ("anna", &long),
        ("nobody", PASSWORD),
        ("", ""),
        (&long, PASSWORD),
        ("bot", ""),
        ("bot", PASSWORD),
        ("ANNA", PASSWORD),
    ] {
        let refused = accounts.sign_in(who, password, HOME, start()).expect_err(who);
        assert_eq!(refused, SignInRefusal::Wrong, "{who}");
    }
}

/// Returns how long the kernel has let this thread compute; other tests do not change that.
fn computed() -> Duration {
    let text = fs::read_to_string("/proc/thread-self/schedstat").expect("Linux");
    let nanos = text.split(' ').next().and_then(|first| first.parse().ok());
    Duration::from_nanos(nanos.expect("a number"))
}

/// The check of an unknown name takes about as long as that of a wrong password. The shortest of some
/// runs in turns counts.
#[test]
fn the_time_of_an_answer_does_not_tell_whether_a_name_exists() {
    let folder = PeopleFolder::new();
    let mut anna = record("anna", &[]);
    let cost = PasswordCost::RECOMMENDED;
    anna.password = Some(StoredPassword::hash(PASSWORD, cost).expect("memory"));
    folder.add(anna);
    let accounts = folder.accounts();
    let time = |who: &str, turn: u64| {
        let now = start() + Duration::from_secs(7_200 * turn);
        let began = computed();
        let refused = accounts.sign_in(who, "a wrong password", AWAY, now);
        assert_eq!(refused.expect_err("wrong"), SignInRefusal::Wrong);
        computed() - began
    };
    let times = (0..7).map(|turn| (time("anna", turn), time("nobody", turn)));
    let longest = (Duration::MAX, Duration::MAX);
    let (known, unknown) =
        times.fold(longest, |least, (known, unknown)| (least.0.min(known), least.1.min(unknown)));
    assert!(unknown < known * 3 && known < unknown * 3, "{known:?} and {unknown:?}");
}

#[test]
fn a_session_ends_when_it_is_not_used_and_after_half_a_day() {
    let folder = PeopleFolder::with(&["anna"]);
    let accounts = folder.accounts();
    let idle = enter(&accounts, "anna");
    let number = idle.signed_in.session;
    assert_eq!(idle.signed_in.ends_at, start() + SESSION_IDLE_MAX);
    let before = start() + SESSION_IDLE_MAX - Duration::from_secs(1);
    assert!(accounts.is_open(number, before), "looking does not prolong it");
    assert!(accounts.session_of_page(&idle.secret, before).is_some(), "nor does an open page");
    assert!(!accounts.is_open(number, start() + SESSION_IDLE_MAX));
    assert_eq!(accounts.session(&idle.secret, start() + SESSION_IDLE_MAX), None);
    assert_eq!(accounts.session(&idle.secret, before), None, "it has ended for good");

    let used = enter(&accounts, "anna");
    let mut now = start();
    while now < start() + SESSION_LASTS {
        assert!(accounts.session(&used.secret, now).is_some(), "it is used");
        now += SESSION_IDLE_MAX / 2;
    }
    assert_eq!(accounts.session(&used.secret, now), None);
}

#[test]
fn a_clock_that_jumps_ends_no_session_early_and_keeps_none_for_ever() {
    let folder = PeopleFolder::with(&["anna"]);
    let accounts = folder.accounts();
    let session = enter(&accounts, "anna");
    let year = Duration::from_secs(365 * 24 * 3_600);
    let mut now = start() - year;
    let end = now + SESSION_LASTS;
    while now < end {
        assert!(accounts.session(&session.secret, now).is_some());
        now += SESSION_IDLE_MAX / 2;
    }
    assert_eq!(accounts.session(&session.secret, now), None);
}

#[test]
fn a_person_that_is_removed_is_signed_out_at_once() {
    let folder = PeopleFolder::with(&["anna", "ben"]);
    let accounts = folder.accounts();
    let (anna, ben) = (enter(&accounts, "anna"), enter(&accounts, "ben"));
    let token = folder.token("anna", "one");
    assert!(accounts.refresh().expect("a file"));
    assert!(accounts.program(&token, HOME, start()).is_ok());
    let mut changes = accounts.changes();
    changes.mark_unchanged();
    folder.file.change(|people| people.remove("anna")).expect("a change");
    assert!(accounts.refresh().expect("a file"));
    assert!(!accounts.refresh().expect("a file"), "it has not changed again");
    assert!(changes.has_changed().expect("a sender"));
    assert_eq!(accounts.session(&anna.secret, start()), None);
    assert_eq!(accounts.program(&token, HOME, start()), Err(SignInRefusal::Wrong));
    assert!(accounts.session(&ben.secret, start()).is_some());
}

#[test]
fn another_password_ends_sessions_and_other_rights_count_at_once() {
    let folder = PeopleFolder::with(&["anna", "ben"]);
    let accounts = folder.accounts();
    let (anna, ben) = (enter(&accounts, "anna"), enter(&accounts, "ben"));
    folder
        .file
        .change(|people| {
            people.set_password("anna", hashed("another password"))?;
            people.set_rights("ben", [PersonRight::Ask].into())
        })
        .expect("a change");
    assert!(accounts.refresh().expect("a file"));
    assert_eq!(accounts.session(&anna.secret, start()), None);
    let ben = accounts.session(&ben.secret, start()).expect("a session").person;
    assert!(ben.may(PersonRight::Ask) && !ben.may(PersonRight::Look));
    let refused = accounts.sign_in("anna", PASSWORD, HOME, start());
    assert_eq!(refused.expect_err("the old one"), SignInRefusal::Wrong);
    assert!(accounts.sign_in("anna", "another password", HOME, start()).is_ok());
}

#[test]
fn a_person_that_is_added_can_sign_in_at_once() {
    let folder = PeopleFolder::new();
    let accounts = folder.accounts();
    assert!(accounts.is_empty());
    folder.add(record("anna", &[]));
    enter(&accounts, "anna");
    assert!(!accounts.is_empty());
}

#[test]
fn a_file_with_mistakes_changes_nothing_until_it_is_mended() {
    let folder = PeopleFolder::with(&["anna"]);
    let accounts = folder.accounts();
    let anna = enter(&accounts, "anna");
    let text = fs::read_to_string(folder.file.path()).expect("a text");
    fs::write(folder.file.path(), "[people.anna\n").expect("ours");
    assert!(accounts.refresh().is_err());
    assert!(accounts.session(&anna.secret, start()).is_some());
    fs::write(folder.file.path(), text).expect("ours");
    assert!(accounts.refresh().expect("mended"));
    assert!(accounts.session(&anna.secret, start()).is_some());
    fs::remove_file(folder.file.path()).expect("ours");
    assert!(accounts.refresh().expect("no file"));
    assert!(accounts.is_empty());
    assert_eq!(accounts.session(&anna.secret, start()), None);
}

#[test]
fn sessions_of_a_person_are_bounded() {
    let folder = PeopleFolder::with(&["anna", "ben"]);
    let accounts = folder.accounts();
    let ben = enter(&accounts, "ben");
    let sessions: Vec<_> = (0..20_u64)
        .map(|turn| {
            let now = start() + Duration::from_secs(turn);
            accounts.sign_in("anna", PASSWORD, HOME, now).expect("the password is right")
        })
        .collect();
    let is_open = |session: &NewSession| accounts.is_open(session.signed_in.session, start());
    let open: Vec<_> = sessions.iter().map(is_open).collect();
    assert_eq!(open, [vec![false; 4], vec![true; 16]].concat());
    assert!(is_open(&ben));
}

#[test]
fn programs_have_the_rights_of_their_person() {
    let folder = PeopleFolder::with(&["anna"]);
    let (one, two) = (folder.token("anna", "one"), folder.token("anna", "two"));
    assert!(one.starts_with("althing_") && one != two);
    let accounts = folder.accounts();
    let person = accounts.program(&one, AWAY, start()).expect("a token");
    assert!(person.may(PersonRight::Look) && !person.may(PersonRight::Ask));
    for wrong in ["", "althing_", &one[..one.len() - 1], &format!("{one} "), &"x".repeat(10_000)] {
        assert_eq!(accounts.program(wrong, AWAY, start()), Err(SignInRefusal::Wrong), "{wrong}");
    }
    for _ in 0..20 {
        let _ = accounts.program("wrong", AWAY, start());
    }
    let refused = accounts.program("wrong", AWAY, start());
    assert!(matches!(refused, Err(SignInRefusal::TooMany { .. })), "{refused:?}");
    assert!(accounts.program(&one, AWAY, start()).is_ok(), "a right token is never made to wait");
    folder.file.change(|people| people.remove_token("anna", "one")).expect("a change");
    assert!(accounts.refresh().expect("a file"));
    assert!(accounts.program(&one, AWAY, start()).is_err());
    assert!(accounts.program(&two, AWAY, start()).is_ok());
    // A token is accepted at once, although the file was looked at a moment ago.
    let three = folder.token("anna", "three");
    assert!(accounts.program(&three, AWAY, start()).is_ok());
}

#[test]
fn a_guesser_is_slowed_down_and_the_caretaker_is_not() {
    let folder = PeopleFolder::with(&["anna"]);
    let accounts = folder.accounts();
    enter(&accounts, "anna");
    let mut refused = None;
    for guess in 0..100 {
        let address = IpAddr::from([10, 0, 0, guess]);
        if let Err(SignInRefusal::TooMany { retry_after }) =
            accounts.sign_in("anna", "a wrong guess", address, start())
        {
            refused = Some((guess, retry_after));
            break;
        }
    }
    let (guesses, wait) = refused.expect("the limit of the name is reached");
    assert!(guesses < 10 && wait <= Duration::from_secs(30), "{guesses}, {wait:?}");
    enter(&accounts, "anna");
    let unknown = IpAddr::from([10, 1, 0, 0]);
    let right = accounts.sign_in("anna", PASSWORD, unknown, start());
    assert!(
        matches!(right, Err(SignInRefusal::TooMany { .. })),
        "it tells nothing of the password"
    );
    let later = start() + Duration::from_secs(30);
    assert!(accounts.sign_in("anna", PASSWORD, unknown, later).is_ok());
}

/// A name that does not exist is limited as one that does.
#[test]
fn limits_do_not_tell_whether_a_name_exists() {
    let folder = PeopleFolder::with(&["anna"]);
    let accounts = folder.accounts();
    let refusals = |who: &str, network: u8| -> Vec<String> {
        let refusal = |guess: u8| {
            let address = IpAddr::from([10, network, 0, guess]);
            accounts.sign_in(who, "a wrong guess", address, start()).expect_err("wrong").to_string()
        };
        (0..12).map(refusal).collect()
    };
    assert_eq!(refusals("anna", 1), refusals("nobody", 2));
}

#[test]
fn few_passwords_are_checked_at_a_time() {
    const THREADS: usize = 12;
    let folder = PeopleFolder::new();
    let mut anna = record("anna", &[]);
    let cost = PasswordCost::RECOMMENDED;
    anna.password = Some(StoredPassword::hash(PASSWORD, cost).expect("memory"));
    folder.add(anna);
    let accounts = folder.accounts();
    let begin = Barrier::new(THREADS);
    let results: Vec<_> = std::thread::scope(|scope| {
        let attempt = |number: usize| {
            let (accounts, begin) = (&accounts, &begin);
            let address = IpAddr::from([10, 0, 0, u8::try_from(number).expect("few")]);
            scope.spawn(move || {
                begin.wait();
                accounts.sign_in(&format!("x{number}"), PASSWORD, address, start())
            })
        };
        let threads: Vec<_> = (0..THREADS).map(attempt).collect();
        threads.into_iter().map(|thread| thread.join().expect("no panic")).collect()
    });
    let count = |is_it: fn(&SignInRefusal) -> bool| {
        results.iter().filter(|result| result.as_ref().is_err_and(is_it)).count()
    };
    let checked = count(|refusal| *refusal == SignInRefusal::Wrong);
    let busy = count(|refusal| matches!(refusal, SignInRefusal::Unavailable(_)));
    assert_eq!(checked + busy, THREADS, "{results:?}");
    assert!(checked >= 1 && busy >= 1, "{results:?}");
    // What was not checked does not count, so the next one is checked.
    assert!(accounts.sign_in("anna", PASSWORD, HOME, start()).is_ok());
}
