//! Selection of proposals (docs/design.md, “The two flows”): finds the cheapest set of proposals
//! that covers the goal and has a valid combined plan.
//!
//! The proposals of one agent are alternatives: at most one proposal of each agent is chosen. Sets
//! of the same cost are ordered by their number of agents, then by agent names, so that every Plan
//! Requester chooses the same set.

use std::collections::BTreeMap;

use acl::AgentId;
use acl::content::Proposal;

/// Maximum number of conjuncts for which the cheapest set of proposals is found exactly, by dynamic
/// programming over sets of conjuncts. If there are more conjuncts, each one is assigned to its
/// cheapest bidder, and the second round calls for proposals for bundles of conjuncts.
const EXACT_CONJUNCTS_MAX: usize = 10;

/// Number of sets of proposals that are kept for each covered set of conjuncts. The next best sets
/// are tried if the combined plan of the best set is not valid.
const SETS_KEPT: usize = 4;

/// Alternative proposals of each bidder, one for each set of conjuncts.
pub(crate) type Bids = BTreeMap<AgentId, Vec<Proposal>>;

/// Proposals of different agents that together cover all conjuncts.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Selection {
    pub(crate) chosen: Vec<(AgentId, Proposal)>,
}

impl Selection {
    pub(crate) fn cost(&self) -> f64 {
        self.chosen.iter().map(|(_, proposal)| proposal.cost).sum()
    }
}

/// Returns the conjuncts that no proposal covers.
pub(crate) fn uncovered(conjuncts: &[String], bids: &Bids) -> Vec<String> {
    let is_covered = |conjunct: &&String| {
        bids.values().flatten().any(|proposal| proposal.covers.contains(conjunct))
    };
    conjuncts.iter().filter(|conjunct| !is_covered(conjunct)).cloned().collect()
}

/// Returns the bundles of conjuncts for the second round, each with its agent. An agent that is the
/// cheapest bidder for several conjuncts is called for one proposal for all of them together.
pub(crate) fn bundles(conjuncts: &[String], bids: &Bids) -> Vec<(AgentId, Vec<String>)> {
    let mut wanted: BTreeMap<&AgentId, Vec<String>> = BTreeMap::new();
    for conjunct in conjuncts {
        if let Some((agent, _)) = cheapest_alone(conjunct, bids) {
            wanted.entry(agent).or_default().push(conjunct.clone());
        }
    }
    wanted
        .into_iter()
        .filter(|(agent, bundle)| bundle.len() > 1 && !offers(&bids[*agent], bundle))
        .map(|(agent, bundle)| (agent.clone(), bundle))
        .collect()
}

fn cheapest_alone<'a>(conjunct: &String, bids: &'a Bids) -> Option<(&'a AgentId, &'a Proposal)> {
    bids.iter()
        .flat_map(|(agent, proposals)| proposals.iter().map(move |proposal| (agent, proposal)))
        .filter(|(_, proposal)| proposal.covers == std::slice::from_ref(conjunct))
        .min_by(|(_, a), (_, b)| a.cost.total_cmp(&b.cost))
}

fn offers(proposals: &[Proposal], bundle: &[String]) -> bool {
    proposals.iter().any(|proposal| {
        proposal.covers.len() == bundle.len()
            && bundle.iter().all(|conjunct| proposal.covers.contains(conjunct))
    })
}

/// Returns sets of proposals that cover all conjuncts, cheapest first.
pub(crate) fn selections(conjuncts: &[String], bids: &Bids) -> Vec<Selection> {
    let mut selections = if conjuncts.len() <= EXACT_CONJUNCTS_MAX {
        exact(conjuncts, bids)
    } else {
        by_cheapest_bidder(conjuncts, bids)
    };
    let key = |selection: &Selection| {
        let agents: Vec<_> = selection.chosen.iter().map(|(agent, _)| agent.clone()).collect();
        (agents.len(), agents)
    };
    selections.sort_by(|a, b| a.cost().total_cmp(&b.cost()).then_with(|| key(a).cmp(&key(b))));
    selections
}

fn exact(conjuncts: &[String], bids: &Bids) -> Vec<Selection> {
    let all = (1usize << conjuncts.len()) - 1;
    let mut best: Vec<Vec<Selection>> = vec![Vec::new(); all + 1];
    best[0].push(Selection { chosen: Vec::new() });
    for (agent, proposals) in bids {
        let before = best.clone();
        for (covered, selections) in before.iter().enumerate() {
            for proposal in proposals {
                let mask = mask(conjuncts, proposal);
                // A proposal that adds no conjunct would only add cost.
                if mask & !covered == 0 {
                    continue;
                }
                for selection in selections {
                    let mut chosen = selection.chosen.clone();
                    chosen.push((agent.clone(), proposal.clone()));
                    keep(&mut best[covered | mask], Selection { chosen });
                }
            }
        }
    }
    std::mem::take(&mut best[all])
}

fn mask(conjuncts: &[String], proposal: &Proposal) -> usize {
    conjuncts
        .iter()
        .enumerate()
        .filter(|(_, conjunct)| proposal.covers.contains(conjunct))
        .fold(0, |mask, (index, _)| mask | 1 << index)
}

fn keep(kept: &mut Vec<Selection>, selection: Selection) {
    let rank = |selection: &Selection| (selection.cost(), selection.chosen.len());
    let (cost, agents) = rank(&selection);
    let position = kept.partition_point(|other| {
        let (other_cost, other_agents) = rank(other);
        other_cost < cost || (other_cost == cost && other_agents <= agents)
    });
    kept.insert(position, selection);
    kept.truncate(SETS_KEPT);
}

/// Assigns each conjunct to its cheapest bidder, and uses that bidder's proposal for the whole
/// bundle if there is one. Also returns every proposal that covers all conjuncts alone.
fn by_cheapest_bidder(conjuncts: &[String], bids: &Bids) -> Vec<Selection> {
    let mut groups: BTreeMap<&AgentId, Vec<String>> = BTreeMap::new();
    for conjunct in conjuncts {
        if let Some((agent, _)) = cheapest_alone(conjunct, bids) {
            groups.entry(agent).or_default().push(conjunct.clone());
        }
    }
    let in_one = |agent: &AgentId, group: &Vec<String>| {
        let offered =
            bids[agent].iter().find(|proposal| offers(std::slice::from_ref(proposal), group))?;
        Some((agent.clone(), offered.clone()))
    };
    let grouped: Option<Vec<_>> =
        groups.iter().map(|(agent, group)| in_one(agent, group)).collect();
    let covers_all = |group: &Vec<_>| {
        let count: usize =
            group.iter().map(|(_, proposal): &(AgentId, Proposal)| proposal.covers.len()).sum();
        count == conjuncts.len()
    };
    let alone = bids.iter().flat_map(|(agent, proposals)| {
        proposals
            .iter()
            .filter(|proposal| offers(std::slice::from_ref(proposal), conjuncts))
            .map(|proposal| Selection { chosen: vec![(agent.clone(), proposal.clone())] })
    });
    grouped.filter(covers_all).map(|chosen| Selection { chosen }).into_iter().chain(alone).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Parses lines such as `robot: a=5 b=6 ab=8`, one for each agent with its bids.
    fn bids(lines: &[&str]) -> Bids {
        let proposal = |text: &str| {
            let (covers, cost) = text.split_once('=').expect("a cost");
            let covers = covers.chars().map(String::from).collect();
            let cost = cost.parse().expect("a number");
            Proposal { covers, plan: String::new(), cost }
        };
        let bid = |line: &&str| {
            let (agent, proposals) = line.split_once(": ").expect("an agent");
            let agent = AgentId::new(agent).expect("a name");
            (agent, proposals.split(' ').map(proposal).collect())
        };
        lines.iter().map(bid).collect()
    }

    fn conjuncts(text: &str) -> Vec<String> {
        text.chars().map(String::from).collect()
    }

    /// Checks that the best selection from the bids `lines` is `expected`, written as
    /// `agent:covers` in order.
    #[track_caller]
    fn check(wanted: &str, lines: &[&str], expected: &str) {
        let best = selections(&conjuncts(wanted), &bids(lines)).into_iter().next();
        let words = best.map(|selection| {
            let word = |(agent, proposal): &(AgentId, Proposal)| {
                format!("{agent}:{}", proposal.covers.concat())
            };
            selection.chosen.iter().map(word).collect::<Vec<_>>().join(" ")
        });
        assert_eq!(words.as_deref().unwrap_or("none"), expected, "{lines:?}");
    }

    #[test]
    fn the_cheapest_candidate_wins() {
        check("a", &["robot: a=5", "sensor: a=1"], "sensor:a");
        check("a", &["b-robot: a=5", "a-robot: a=5"], "a-robot:a");
    }

    #[test]
    fn sensors_and_a_robot_share_the_conjuncts() {
        let bids = ["robot: a=5 b=6 c=7 abc=12", "sensor-b: b=1", "sensor-c: c=1"];
        check("abc", &bids, "robot:a sensor-b:b sensor-c:c");
    }

    #[test]
    fn an_agents_proposals_are_alternatives() {
        check("ab", &["robot: a=5 b=6"], "none");
        check("ab", &["robot: a=5 b=6 ab=20"], "robot:ab");
    }

    #[test]
    fn two_robots_share_conjuncts_if_that_is_cheaper() {
        check("ab", &["one: a=5 b=6 ab=10", "two: b=4"], "one:a two:b");
        check("ab", &["one: a=5 b=6 ab=8", "two: b=4"], "one:ab");
    }

    #[test]
    fn bundles_are_called_for_if_one_agent_is_cheapest_for_several() {
        let bids = bids(&["robot: a=5 b=6 c=7 abc=30", "sensor: c=1"]);
        let robot = AgentId::new("robot").expect("a name");
        assert_eq!(bundles(&conjuncts("abc"), &bids), [(robot, conjuncts("ab"))]);
        assert_eq!(uncovered(&conjuncts("abcd"), &bids), conjuncts("d"));
    }

    #[test]
    fn many_conjuncts_go_to_their_cheapest_bidders() {
        let all = "abcdefghijklm";
        let sensors: Vec<_> = all[2..].chars().map(|room| format!("s-{room}: {room}=1")).collect();
        let robot = format!("robot: a=5 b=6 ab=8 {all}=99");
        let lines: Vec<&str> = sensors.iter().map(String::as_str).chain([robot.as_str()]).collect();
        let best = selections(&conjuncts(all), &bids(&lines)).into_iter().next();
        assert_eq!(best.expect("covered").cost(), 19.0);
    }
}
