//! Nothing private is named on the wire.

use std::collections::BTreeSet;

use pddl::factored::AgentFiles;
use pddl::{Effect, Privacy};

use crate::joint::play;
use crate::parcel;

/// Returns the private predicates and objects of a task, and the actions without a public effect.
fn private_words(task: &[AgentFiles]) -> BTreeSet<String> {
    let mut words = BTreeSet::new();
    for AgentFiles { domain, problem, .. } in task {
        let predicates = domain.predicates.iter().filter(|it| it.privacy != Privacy::Public);
        let predicates: BTreeSet<String> = predicates.map(|it| it.name.to_string()).collect();
        let objects = problem.objects.iter().filter(|it| it.privacy != Privacy::Public);
        words.extend(objects.map(|it| it.object.name.to_string()));
        for action in &domain.actions {
            let Effect::And(parts) = &action.effect else { continue };
            let is_private = parts.iter().all(|part| match part {
                Effect::Add(atom) | Effect::Delete(atom) => {
                    predicates.contains(&atom.predicate.to_string())
                }
                _ => false,
            });
            if is_private {
                words.insert(action.name.to_string());
            }
        }
        words.extend(predicates);
    }
    words
}

/// Splits a text into names.
fn words(text: &str) -> BTreeSet<String> {
    let is_part = |letter: char| letter.is_alphanumeric() || "-_".contains(letter);
    text.split(|letter| !is_part(letter)).map(str::to_owned).collect()
}

#[test]
fn no_private_word_is_sent() {
    for (drives, has_key) in [(2, true), (1, true), (2, false)] {
        let task = parcel::task(drives, has_key);
        let private = private_words(&task);
        for word in ["standing", "holding", "charge", "cell1", "drive", "brass", "fetch"] {
            assert!(private.contains(word), "{word} is private");
        }
        let sent = play(&task).sent;
        assert!(sent.iter().any(|text| words(text).contains("parcel-at")), "something is sent");
        for text in &sent {
            let named: Vec<_> = words(text).intersection(&private).cloned().collect();
            assert!(named.is_empty(), "{named:?} in {text}");
        }
    }
}

#[test]
fn other_names_of_private_things_change_nothing_on_the_wire() {
    let sent = |key: &str| {
        let mut task = parcel::task(2, true);
        task[0] = parcel::doorkeeper(key, true);
        play(&task).sent
    };
    assert_eq!(sent("brass"), sent("the-red-one-below-the-mat"));
}
