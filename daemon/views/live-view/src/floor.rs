//! The floor plan: rooms, ways and robots, found in the facts by what moving actions need.

mod layout;

use std::collections::{BTreeMap, BTreeSet};

use acl::{AgentId, ConversationId};

use self::layout::layout;
use crate::fact_store::{FactRecord, FactStore};
use crate::moment::Moment;
use crate::moves::MoveSchemas;
use crate::rows::{FactTruth, FloorPlan, FloorRobot, FloorRoom, FloorWay, Freshness};
use crate::text::number;

/// Maximum number of facts that are shown in one room.
const FACTS_PER_ROOM: usize = 12;

/// The paths of the robots: for each the goal, whether it moves now, and the places ahead.
pub(crate) type Paths = BTreeMap<String, (ConversationId, bool, Vec<String>)>;

/// What a floor plan is made of.
pub(crate) struct FloorSources<'v> {
    pub(crate) facts: &'v FactStore,
    pub(crate) moves: &'v MoveSchemas,
    pub(crate) paths: Paths,
    pub(crate) now: Moment,
    pub(crate) rooms_max: usize,
}

/// The rooms and robots that the facts tell.
#[derive(Default)]
struct FoundRooms<'v> {
    rooms: BTreeSet<&'v str>,
    ways: BTreeSet<(&'v str, &'v str)>,
    /// The room of each robot, and whether that fact is stale.
    robots: BTreeMap<&'v str, (&'v str, bool)>,
}

impl FloorSources<'_> {
    /// Makes the floor plan. `is_away` says of an agent whether it is gone or silent, and
    /// `is_stopped` of a name whether a stop concerns it.
    pub(crate) fn plan(
        &self,
        is_away: &impl Fn(&str) -> bool,
        is_stopped: &impl Fn(&str) -> bool,
    ) -> FloorPlan {
        if self.moves.places.is_empty() {
            let why = "no agent that was observed offers an action that moves it between places";
            return FloorPlan { empty_because: why.to_owned(), ..FloorPlan::default() };
        }
        let found = self.find(is_away);
        if found.rooms.is_empty() {
            let why = "no ways between places are known yet";
            return FloorPlan { empty_because: why.to_owned(), ..FloorPlan::default() };
        }
        let names: Vec<_> = found.rooms.iter().copied().take(self.rooms_max).collect();
        let index: BTreeMap<_, _> = names.iter().zip(0..).map(|(name, at)| (*name, at)).collect();
        let mut neighbors = vec![Vec::new(); names.len()];
        let mut ways = Vec::new();
        for (from, to) in &found.ways {
            let (Some(one), Some(other)) = (index.get(from), index.get(to)) else { continue };
            let is_back = found.ways.contains(&(*to, *from));
            // A way in both directions is listed once.
            if is_back && from > to {
                continue;
            }
            neighbors[*one].push(*other);
            neighbors[*other].push(*one);
            let (from, to) = ((*from).to_owned(), (*to).to_owned());
            ways.push(FloorWay { from, to, both_ways: is_back });
        }
        let places = layout(&neighbors);
        let rooms = names.iter().zip(places).map(|(name, (x, y))| FloorRoom {
            name: (*name).to_owned(),
            x,
            y,
            robots: Vec::new(),
            facts: Vec::new(),
            is_stale: false,
            is_stopped: is_stopped(name),
        });
        let mut rooms: Vec<_> = rooms.collect();
        self.furnish(&mut rooms, &index, is_away);
        let robots = self.robots(&found, is_away, is_stopped);
        for robot in &robots {
            let room = robot.room.as_deref().and_then(|room| index.get(room));
            if let Some(room) = room {
                rooms[*room].robots.push(robot.agent.clone());
            }
        }
        let more = found.rooms.len().saturating_sub(names.len());
        let more_rooms = u64::try_from(more).unwrap_or(u64::MAX);
        FloorPlan { rooms, ways, robots, more_rooms, empty_because: String::new() }
    }

    fn find(&self, is_away: &impl Fn(&str) -> bool) -> FoundRooms<'_> {
        let mut found = FoundRooms::default();
        for (_, record) in self.facts.iter().filter(|(_, record)| holds(record)) {
            let fact = &record.fact;
            let argument = |index: usize| fact.arguments.get(index).map(String::as_str);
            for way in self.moves.ways.iter().filter(|way| way.predicate == fact.predicate) {
                let (Some(first), Some(second)) = (argument(0), argument(1)) else { continue };
                let way = if way.is_reversed { (second, first) } else { (first, second) };
                found.rooms.extend([first, second]);
                found.ways.insert(way);
            }
            for at in self.moves.places.iter().filter(|at| at.predicate == fact.predicate) {
                let (Some(mover), Some(place)) = (argument(at.mover), argument(at.place)) else {
                    continue;
                };
                let freshness = self.facts.freshness(record, self.now, is_away);
                found.rooms.insert(place);
                found.robots.insert(mover, (place, freshness == Freshness::Stale));
            }
        }
        found
    }

    /// Adds the facts about each room alone. Values come first.
    fn furnish(
        &self,
        rooms: &mut [FloorRoom],
        index: &BTreeMap<&str, usize>,
        is_away: &impl Fn(&str) -> bool,
    ) {
        for wants_value in [true, false] {
            for (_, record) in self.facts.iter() {
                let fact = &record.fact;
                let [only] = fact.arguments.as_slice() else { continue };
                let Some(at) = index.get(only.as_str()) else { continue };
                if fact.value.is_some() != wants_value || fact.truth == FactTruth::False {
                    continue;
                }
                let room = &mut rooms[*at];
                let freshness = self.facts.freshness(record, self.now, is_away);
                room.is_stale |= freshness == Freshness::Stale || fact.truth == FactTruth::Unknown;
                if room.facts.len() < FACTS_PER_ROOM {
                    room.facts.push(match (fact.truth, fact.value) {
                        (FactTruth::Unknown, _) => format!("{} unknown", fact.predicate),
                        (_, Some(value)) => format!("{} {}", fact.predicate, number(value)),
                        (_, None) => fact.predicate.clone(),
                    });
                }
            }
        }
    }

    fn robots(
        &self,
        found: &FoundRooms<'_>,
        is_away: &impl Fn(&str) -> bool,
        is_stopped: &impl Fn(&str) -> bool,
    ) -> Vec<FloorRobot> {
        let names: BTreeSet<_> =
            found.robots.keys().copied().chain(self.paths.keys().map(String::as_str)).collect();
        let robots = names.into_iter().filter_map(|name| {
            let agent = AgentId::new(name).ok()?;
            let place = found.robots.get(name);
            let path = self.paths.get(name);
            let (moves_now, ahead) = match path {
                Some((_, moves_now, ahead)) => (*moves_now, ahead.as_slice()),
                None => (false, [].as_slice()),
            };
            Some(FloorRobot {
                agent,
                room: place.map(|(room, _)| (*room).to_owned()),
                moves_to: ahead.first().filter(|_| moves_now).cloned(),
                path: ahead.to_vec(),
                conversation: path.map(|(conversation, ..)| conversation.clone()),
                is_stopped: is_stopped(name) || place.is_some_and(|(room, _)| is_stopped(room)),
                is_stale: is_away(name) || place.is_some_and(|(_, is_stale)| *is_stale),
            })
        });
        robots.collect()
    }
}

fn holds(record: &FactRecord) -> bool {
    record.fact.truth == FactTruth::True
}
