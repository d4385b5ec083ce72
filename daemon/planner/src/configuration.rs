//! The ways to search that can be asked for by name: the one table that defines them.

use crate::search::lazy::List;

/// A way to search; an entry of [`CONFIGURATIONS`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Configuration {
    /// What it is called.
    pub name: &'static str,
    /// One line about it.
    pub summary: &'static str,
    /// The names of the heuristics it uses.
    pub heuristics: &'static [&'static str],
    /// Whether its first plan is the cheapest.
    pub optimal: bool,
    pub(crate) method: Method,
}

/// What a configuration does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Method {
    /// Open lists that take turns; after a quick climb, or at once.
    Lists { climb: bool, lists: &'static [List] },
    /// A* with an admissible heuristic.
    AStar { heuristic: &'static str },
}

/// One entry per way to search, the default first. All are complete: where they end without a plan
/// and without a limit, there is none.
pub const CONFIGURATIONS: &[Configuration] = &[
    Configuration {
        name: "althing",
        summary: "a quick climb; then landmarks, preferred operators, novelty and types take turns",
        heuristics: &["ff", "landmarks", "novelty"],
        optimal: false,
        method: Method::Lists {
            climb: true,
            lists: &[
                List::Ff,
                List::FfPreferred,
                List::LandmarksPreferred,
                List::Novel,
                List::Landmarks,
                List::Types,
            ],
        },
    },
    Configuration {
        name: "nolan",
        summary: "LAMA with novelty instead of landmarks for all (Corrêa and Seipp, 2025)",
        heuristics: &["ff", "landmarks", "novelty"],
        optimal: false,
        method: Method::Lists {
            climb: false,
            lists: &[List::Ff, List::FfPreferred, List::LandmarksPreferred, List::Novel],
        },
    },
    Configuration {
        name: "lama-first",
        summary: "two heuristics, each for all and for preferred operators (Richter and Westphal, \
                  2010)",
        heuristics: &["ff", "landmarks"],
        optimal: false,
        method: Method::Lists {
            climb: false,
            lists: &[List::Ff, List::FfPreferred, List::Landmarks, List::LandmarksPreferred],
        },
    },
    Configuration {
        name: "curious",
        summary: "what is new before what looks near; the second lane of two threads",
        heuristics: &["ff", "landmarks", "novelty"],
        optimal: false,
        method: Method::Lists { climb: false, lists: CURIOUS },
    },
    Configuration {
        name: "astar-lmcut",
        summary: "A* (Hart, Nilsson and Raphael, 1968), each landmark cut paid for once",
        heuristics: &["lmcut"],
        optimal: true,
        method: Method::AStar { heuristic: "lmcut" },
    },
    Configuration {
        name: "astar-max",
        summary: "A* with a weak but quick heuristic",
        heuristics: &["max"],
        optimal: true,
        method: Method::AStar { heuristic: "max" },
    },
    Configuration {
        name: "astar-blind",
        summary: "A* that knows nothing",
        heuristics: &["blind"],
        optimal: true,
        method: Method::AStar { heuristic: "blind" },
    },
];

/// The lists of the search that runs beside another.
pub(crate) const CURIOUS: &[List] = &[List::Ff, List::Novel, List::Landmarks, List::Types];

/// The entry of this name.
pub fn configuration(name: &str) -> Option<&'static Configuration> {
    CONFIGURATIONS.iter().find(|one| one.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::heuristic::HEURISTICS;

    #[test]
    fn every_entry_names_heuristics_that_there_are() {
        for one in CONFIGURATIONS {
            for name in one.heuristics {
                assert!(HEURISTICS.iter().any(|heuristic| heuristic.name == *name), "{name}");
            }
            assert_eq!(configuration(one.name), Some(one));
        }
    }
}
