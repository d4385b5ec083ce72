//! Prints a layout as the map of a PDDL problem: what no agent brings.
//!
//! Rooms, corridors, doors and distances; devices are not here, because they
//! announce themselves. Only prints: reading PDDL is the `pddl` crate's work.

use std::fmt::Write as _;

use crate::layout::{Layout, LocationKind};

impl Layout {
    /// The map as the text of a problem for the domain `domain_name`.
    ///
    /// Each connection is printed in every direction it can be gone. The goal is
    /// the empty conjunction, which always holds: people bring the goals.
    pub fn map_pddl(&self, domain_name: &str) -> String {
        format!(
            "(define (problem {domain_name}-map)\n  (:domain {domain_name})\n  (:objects{})\n  \
             (:init\n    (= (total-cost) 0){})\n  (:goal (and))\n  (:metric minimize (total-cost)))\n",
            self.objects_pddl(),
            self.ways_pddl(),
        )
    }

    fn objects_pddl(&self) -> String {
        let mut text = String::new();
        for (kind, type_name) in
            [(LocationKind::Room, "room"), (LocationKind::Corridor, "corridor")]
        {
            let of_kind = self.locations().iter().filter(|location| location.kind == kind);
            let names: Vec<&str> = of_kind.map(|location| location.name.as_str()).collect();
            if !names.is_empty() {
                push(&mut text, format_args!("\n    {} - {type_name}", names.join(" ")));
            }
        }
        text
    }

    fn ways_pddl(&self) -> String {
        let mut text = String::new();
        for way in self.connections() {
            push_way(&mut text, &way.from, &way.to, way.meters);
            if !way.one_way {
                push_way(&mut text, &way.to, &way.from, way.meters);
            }
        }
        text
    }
}

fn push_way(text: &mut String, from: &str, to: &str, meters: f64) {
    push(text, format_args!("\n    (connected {from} {to}) (= (distance {from} {to}) {meters})"));
}

fn push(text: &mut String, piece: std::fmt::Arguments<'_>) {
    text.write_fmt(piece).expect("invariant: writing to a String cannot fail");
}
