//! Search configurations, which a caller chooses by name. All are defined in one table.

use crate::heuristic::Admissible;
use crate::search::lazy::{EXPLORATION_LISTS, List};

/// A search configuration; an entry of [`CONFIGURATIONS`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Configuration {
    /// Name for choosing the configuration.
    pub name: &'static str,
    /// Description of the configuration, in one line.
    pub summary: &'static str,
    /// Names of the configuration's heuristics, each an entry of [`HEURISTICS`](crate::HEURISTICS).
    pub heuristics: &'static [&'static str],
    /// Whether the first plan that the search finds has the least possible cost.
    pub optimal: bool,
    pub(crate) method: SearchMethod,
}

/// Search algorithm of a configuration, with its parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SearchMethod {
    /// Lazy greedy search with several open lists, which are used in turn. If `is_quick` is set,
    /// enforced hill climbing is tried first, and then one part of the goal after the other.
    Lists { is_quick: bool, lists: &'static [List] },
    /// A* with an admissible heuristic.
    AStar { heuristic: Admissible },
}

/// All configurations; the first is the default. Each is complete: if its search ends without a
/// plan and without reaching a limit, no plan exists.
pub const CONFIGURATIONS: &[Configuration] = &[
    Configuration {
        name: "althing",
        summary: "hill climbing; goal by goal; then landmarks, preferred operators, novelty and types in \
                  turn",
        heuristics: &["ff", "landmarks", "novelty"],
        optimal: false,
        method: SearchMethod::Lists {
            is_quick: true,
            lists: &[
                List::Ff,
                List::FfPreferred,
                List::LandmarksPreferred,
                List::Novel,
                List::Landmarks,
                List::Types,
                List::Covered,
            ],
        },
    },
    Configuration {
        name: "nolan",
        summary: "LAMA with novelty instead of landmarks for all (Corrêa and Seipp, 2025)",
        heuristics: &["ff", "landmarks", "novelty"],
        optimal: false,
        method: SearchMethod::Lists {
            is_quick: false,
            lists: &[List::Ff, List::FfPreferred, List::LandmarksPreferred, List::Novel],
        },
    },
    Configuration {
        name: "lama-first",
        summary: "two heuristics, each for all and for preferred operators (Richter and Westphal, \
                  2010)",
        heuristics: &["ff", "landmarks"],
        optimal: false,
        method: SearchMethod::Lists {
            is_quick: false,
            lists: &[List::Ff, List::FfPreferred, List::Landmarks, List::LandmarksPreferred],
        },
    },
    Configuration {
        name: "curious",
        summary: "novelty before estimated distance; the second search of two threads",
        heuristics: &["ff", "landmarks", "novelty"],
        optimal: false,
        method: SearchMethod::Lists { is_quick: false, lists: EXPLORATION_LISTS },
    },
    Configuration {
        name: "astar-lmcut",
        summary: "A* (Hart, Nilsson and Raphael, 1968), each landmark cut paid for once",
        heuristics: &["lmcut"],
        optimal: true,
        method: SearchMethod::AStar { heuristic: Admissible::LandmarkCut },
    },
    Configuration {
        name: "astar-max",
        summary: "A* with a weak but quick heuristic",
        heuristics: &["max"],
        optimal: true,
        method: SearchMethod::AStar { heuristic: Admissible::Max },
    },
    Configuration {
        name: "astar-blind",
        summary: "A* without a heuristic",
        heuristics: &["blind"],
        optimal: true,
        method: SearchMethod::AStar { heuristic: Admissible::Blind },
    },
];

/// Returns the configuration with this name; `None` if there is none.
pub fn configuration(name: &str) -> Option<&'static Configuration> {
    CONFIGURATIONS.iter().find(|one| one.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::heuristic::HEURISTICS;

    #[test]
    fn every_configuration_names_existing_heuristics() {
        for one in CONFIGURATIONS {
            for name in one.heuristics {
                assert!(HEURISTICS.iter().any(|heuristic| heuristic.name == *name), "{name}");
            }
            if let SearchMethod::AStar { heuristic } = one.method {
                assert_eq!(one.heuristics, [heuristic.name()]);
                let entry = HEURISTICS.iter().find(|entry| entry.name == heuristic.name());
                assert!(entry.is_some_and(|entry| entry.admissible), "{heuristic:?}");
            }
            assert_eq!(configuration(one.name), Some(one));
        }
    }
}
