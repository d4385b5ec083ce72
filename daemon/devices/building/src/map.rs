//! Prints a layout as the map of an ecosystem, in both forms in which an ecosystem has one: a PDDL
//! problem, and the tables `[rooms]` and `[doors]` of its file.
//!
//! The map has rooms, corridors, doors and distances. It has no devices, because their agents
//! announce them.

use std::fmt::Write as _;

use crate::layout::{Layout, LocationConnection, LocationKind};

impl Layout {
    /// Returns the map as the text of a PDDL problem for the domain `domain_name`.
    ///
    /// Each connection is printed once per direction that a robot can take. The goal is the empty
    /// conjunction, which always holds, because goals come from the users.
    pub fn map_pddl(&self, domain_name: &str) -> String {
        format!(
            "(define (problem {domain_name}-map)\n  (:domain {domain_name})\n  (:objects{})\n  \
             (:init\n    (= (total-cost) 0){})\n  (:goal (and))\n  (:metric minimize (total-cost)))\n",
            self.objects_pddl(),
            self.ways_pddl(),
        )
    }

    /// Returns the map as the tables `[rooms]` and `[doors]` of an ecosystem file.
    pub fn map_tables(&self) -> String {
        let mut text = "[rooms]\n".to_owned();
        for location in self.locations() {
            let said = match location.kind {
                LocationKind::Room => "{}",
                LocationKind::Corridor => "{ kind = \"corridor\" }",
            };
            push(&mut text, format_args!("{} = {said}\n", location.name));
        }
        text.push_str("\n[doors]\n");
        for location in self.locations() {
            let from_here = |way: &&LocationConnection| way.from == location.name;
            let doors: Vec<String> =
                self.connections().iter().filter(from_here).map(door).collect();
            if !doors.is_empty() {
                push(&mut text, format_args!("{} = {{ {} }}\n", location.name, doors.join(", ")));
            }
        }
        text
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
            let mut push_both = |from: &str, to: &str| {
                // A door with a motor says itself whether it connects its sides.
                if !self.has_door(from, to) {
                    push(&mut text, format_args!("\n    (connected {from} {to})"));
                } else {
                    text.push_str("\n   ");
                }
                push(&mut text, format_args!(" (= (distance {from} {to}) {})", way.meters));
            };
            push_both(&way.from, &way.to);
            if !way.one_way {
                push_both(&way.to, &way.from);
            }
        }
        text
    }
}

/// Returns a door as a key of the table of the place that it leads from.
fn door(way: &LocationConnection) -> String {
    let LocationConnection { from: _, to, meters, one_way } = way;
    match one_way {
        true => format!("{to} = {{ length = {meters}, one-way = true }}"),
        false => format!("{to} = {meters}"),
    }
}

fn push(text: &mut String, piece: std::fmt::Arguments<'_>) {
    text.write_fmt(piece).expect("invariant: writing to a String cannot fail");
}

#[cfg(test)]
mod tests {
    use expect_test::expect;

    use crate::Layout;

    #[test]
    fn a_map_has_every_direction_and_no_devices() {
        let mut layout = Layout::new();
        layout.add_room("lab", 20.0).unwrap().add_corridor("hall", 19.0).unwrap();
        layout.add_room("vault", 12.0).unwrap().connect("hall", "lab", 2.5).unwrap();
        layout.connect_one_way("hall", "vault", 10.0).unwrap();
        layout.add_robot("rover", "hall", 1.0).unwrap();
        expect![[r#"
            (define (problem smart-office-map)
              (:domain smart-office)
              (:objects
                lab vault - room
                hall - corridor)
              (:init
                (= (total-cost) 0)
                (connected hall lab) (= (distance hall lab) 2.5)
                (connected lab hall) (= (distance lab hall) 2.5)
                (connected hall vault) (= (distance hall vault) 10))
              (:goal (and))
              (:metric minimize (total-cost)))
        "#]]
        .assert_eq(&layout.map_pddl("smart-office"));
        expect![[r#"
            [rooms]
            lab = {}
            hall = { kind = "corridor" }
            vault = {}

            [doors]
            hall = { lab = 2.5, vault = { length = 10, one-way = true } }
        "#]]
        .assert_eq(&layout.map_tables());
    }

    /// Compares the tables in the repository with those of the building of seed 0.
    #[test]
    fn the_tables_of_seed_0_are_those_of_the_smart_office() {
        let file = include_str!("../../../../ecosystems/smart-office.toml");
        let file: toml::Table = toml::from_str(file).expect("a table");
        let seeded = Layout::seeded(0).layout.map_tables();
        let seeded: toml::Table = toml::from_str(&seeded).expect("a table");
        let meters = |doors: &toml::Value| doors.to_string().replace(".0", "");
        assert_eq!(file["rooms"], seeded["rooms"]);
        assert_eq!(meters(&file["doors"]), meters(&seeded["doors"]));
    }

    /// Compares the map in the repository with the map of the building of seed 0.
    #[test]
    fn the_map_of_seed_0_is_that_of_the_smart_office() {
        let file = include_str!("../../../../domains/smart-office/map.pddl");
        let code = file.lines().map(|line| line.split(';').next().unwrap_or_default());
        let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(
            words(&code.collect::<Vec<_>>().join("\n")),
            words(&Layout::seeded(0).layout.map_pddl("smart-office")),
        );
    }
}
