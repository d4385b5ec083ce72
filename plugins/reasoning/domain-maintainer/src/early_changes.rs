//! Changes that are requested from a leader before it could read the Journals: the metric and the
//! withheld actions. They are younger than those of the record, and apply in place of them. The state
//! machine in `capability` does the same with facts.

use std::collections::BTreeSet;

use acl::AgentId;
use capability::RequestedChanges;
use pddl::Name;

/// Changes that were requested before the Journals could be read.
#[derive(Debug, Default)]
pub(crate) struct EarlyChanges {
    /// Whether the requested changes have not been written to the Journals.
    pub(crate) is_unwritten: bool,
    has_metric: bool,
    given_back: BTreeSet<(Name, Option<AgentId>)>,
}

// === impl EarlyChanges ===

impl EarlyChanges {
    /// Notes that the metric was changed.
    pub(crate) fn note_metric(&mut self) {
        self.has_metric = true;
    }

    /// Notes that some actions were withheld and others were given back.
    pub(crate) fn note_actions(
        &mut self,
        withheld: &[(Name, Option<AgentId>)],
        given_back: &[(Name, Option<AgentId>)],
    ) {
        self.given_back.extend(given_back.iter().cloned());
        withheld.iter().for_each(|of| {
            self.given_back.remove(of);
        });
    }

    /// Returns the changes of the record `earlier` with the metric and the withheld actions that
    /// follow if these changes are put upon it. `present` are the changes in force at this replica.
    pub(crate) fn put_upon(
        self,
        earlier: RequestedChanges,
        present: RequestedChanges,
    ) -> RequestedChanges {
        let metric = if self.has_metric { present.metric } else { earlier.metric };
        let stays = earlier.withheld.into_iter().filter(|of| !self.given_back.contains(of));
        let withheld: BTreeSet<_> = stays.chain(present.withheld).collect();
        RequestedChanges { metric, withheld: withheld.into_iter().collect(), ..earlier }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn withheld(names: &[&str]) -> Vec<(Name, Option<AgentId>)> {
        names.iter().map(|name| ((*name).into(), None)).collect()
    }

    fn changes(metric: Option<&str>, names: &[&str]) -> RequestedChanges {
        let metric = metric.map(|text| pddl::parse_metric(text).into_result().expect("a metric"));
        RequestedChanges { metric, withheld: withheld(names), ..RequestedChanges::default() }
    }

    #[test]
    fn younger_changes_are_put_upon_the_record() {
        let slow = Some("(:metric minimize (total-cost))");
        let record = changes(slow, &["move", "open"]);
        let same = EarlyChanges::default().put_upon(record.clone(), changes(None, &["lift"]));
        assert_eq!(same, changes(slow, &["lift", "move", "open"]));
        let mut early = EarlyChanges::default();
        early.note_metric();
        early.note_actions(&withheld(&["move", "open"]), &[]);
        early.note_actions(&[], &withheld(&["open"]));
        let other = early.put_upon(record, changes(None, &["move"]));
        assert_eq!(other, changes(None, &["move"]), "the metric is that of the map again");
    }
}
