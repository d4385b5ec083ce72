//! Notifications to browsers: the page adds and removes subscriptions in the store of a notifier
//! that this daemon hosts. The notifier sends.

use std::path::Path;

use accounts::PersonName;
use acl::AgentId;
use notifier::{PushStore, PushStoreError, PushSubscription};
use serde_json::json;
use web_page::{PushAnswer, PushAsk};

use crate::config::{AgentEntry, Ecosystem};

/// Returns the names of the notifiers that the ecosystem file names.
pub(super) fn notifiers(ecosystem: &Ecosystem) -> Vec<AgentId> {
    let is_notifier = |entry: &&AgentEntry| entry.plugin == notifier::PLUGIN.name;
    ecosystem.agents.iter().filter(is_notifier).map(|entry| entry.name.clone()).collect()
}

/// Carries out what a person asks for about notifications; `None` if no notifier of this daemon
/// sends any. Blocks the thread.
pub(super) fn carry_out(
    notifiers: &[AgentId],
    state: &Path,
    person: &PersonName,
    ask: PushAsk,
) -> Option<PushAnswer> {
    let mut stores = notifiers.iter().map(|agent| PushStore::open(state, agent));
    let store = stores.find(|store| !matches!(store, Err(PushStoreError::Missing)))?;
    let failed = |error: PushStoreError| format!("failed to {error}");
    let answer = store.map_err(failed).and_then(|store| match ask {
        PushAsk::Key => Ok(json!({ "public_key": store.public_key() })),
        PushAsk::Subscribe(subscription) => {
            let read = serde_json::from_value::<PushSubscription>(subscription);
            let read = read.map_err(|error| format!("this is no subscription: {error}"))?;
            let subscription = PushSubscription { person: person.as_str().to_owned(), ..read };
            store.subscribe(subscription).map_err(failed)?;
            Ok(json!({ "subscribed": true }))
        }
        PushAsk::Remove { endpoint } => {
            store.unsubscribe(&endpoint).map_err(failed)?;
            Ok(json!({ "subscribed": false }))
        }
    });
    Some(answer)
}

/// Removes the subscriptions of people that are not known any more. Blocks the thread.
pub(super) fn forget_strangers(notifiers: &[AgentId], state: &Path, people: &[PersonName]) {
    for store in notifiers.iter().filter_map(|agent| PushStore::open(state, agent).ok()) {
        let subscriptions = store.subscriptions().unwrap_or_default();
        let is_known = |name: &str| people.iter().any(|person| person.as_str() == name);
        for gone in subscriptions.iter().filter(|it| !is_known(&it.person)) {
            if let Err(error) = store.forget_person(&gone.person) {
                tracing::warn!("a person that was removed may be notified: failed to {error}");
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_notifier_none_is_sent() {
        let state = tempfile::tempdir().expect("a folder");
        let person = PersonName::new("ada").expect("a name");
        let names = [AgentId::new("notifier").expect("a name")];
        for names in [&names[..], &[]] {
            assert!(carry_out(names, state.path(), &person, PushAsk::Key).is_none());
            forget_strangers(names, state.path(), &[]);
        }
    }
}
