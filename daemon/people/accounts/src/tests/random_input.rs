//! Random input: whatever a file, a name, a password, a token or a cookie is, nothing panics.

use proptest::prelude::*;

use super::{AWAY, PeopleFolder, start};
use crate::{
    PersonName, SecretDigest, StoredPassword, check_new_password, read_people, without_secrets,
};

/// Returns pieces of files of people, in any order, so that some texts are nearly right.
fn pieces() -> impl Strategy<Value = String> {
    let piece = prop_oneof![
        Just("[people.anna]\n".to_owned()),
        Just("[[people.anna.token]]\n".to_owned()),
        Just("rights = [\"look\", \"ask\"]\n".to_owned()),
        Just("password = \"$argon2id$v=19$m=8,t=1,p=1$c2FsdHNhbHQ$".to_owned()),
        Just("hash = \"sha256:00\"\n".to_owned()),
        Just("people = 3\n".to_owned()),
        Just("name = \"é\u{1b}\"\n".to_owned()),
        Just("token = [1, {}, []]\n".to_owned()),
        Just("'''\n".to_owned()),
        Just("{".to_owned()),
        "\\PC{0,12}",
        "[a-z\\[\\].=\"\n]{0,12}",
    ];
    prop::collection::vec(piece, 0..12).prop_map(|pieces| pieces.concat())
}

proptest! {
    #[test]
    fn files_never_panic_and_each_mistake_has_a_place(text in pieces()) {
        let read = read_people(&text);
        for found in &read.mistakes {
            prop_assert!(found.span.range().end <= text.len());
            // Points to whole characters.
            let _ = found.located(&text);
        }
        let shown = without_secrets(&text);
        prop_assert_eq!(shown.len(), text.len());
        prop_assert_eq!(shown.matches('\n').count(), text.matches('\n').count());
    }

    #[test]
    fn names_never_panic(text in "\\PC{0,40}|.{0,40}") {
        if let Ok(name) = PersonName::new(&text) {
            prop_assert_eq!(name.as_str(), text.as_str());
            let read = read_people(&format!("[people.{name}]\nrights = []\n"));
            prop_assert!(read.mistakes.is_empty() && read.records.get(&text).is_some());
        }
    }

    #[test]
    fn hashes_and_digests_never_panic(text in "(\\$argon2id\\$v=19\\$)?.{0,80}|sha256:[0-9a-f]{60,66}") {
        let _ = StoredPassword::parse(&text);
        if let Some(digest) = SecretDigest::parse(&text) {
            prop_assert_eq!(digest.to_string(), text);
        }
    }

    #[test]
    fn passwords_never_panic(name in "[a-z]{0,32}", password in ".{0,1100}") {
        if check_new_password(&name, &password).is_ok() {
            prop_assert!(password.chars().count() >= 10 && !password.chars().any(char::is_control));
        }
    }
}

#[test]
fn random_cookies_tokens_and_passwords_let_no_one_in() {
    let folder = PeopleFolder::with(&["anna"]);
    let accounts = folder.accounts();
    let strategy = (".{0,60}", ".{0,200}");
    proptest!(ProptestConfig::with_cases(200), |((name, secret) in strategy)| {
        prop_assert!(accounts.session(&secret, start()).is_none());
        prop_assert!(accounts.program(&secret, AWAY, start()).is_err());
        prop_assert!(accounts.sign_in(&name, &secret, AWAY, start()).is_err());
        accounts.sign_out(&secret);
    });
}
