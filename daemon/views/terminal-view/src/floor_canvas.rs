//! The drawing of a floor plan: boxes for rooms, lines for ways, and heavy lines where robots move.

use live_view::{FloorPlan, FloorRobot, FloorRoom};

use crate::styled_line::StyledLine;
use crate::text;
use crate::tone::Tone;

/// Cells of a room: fewest and most.
const ROOM_MIN: usize = 9;
const ROOM_MAX: usize = 22;

/// Cells between rooms, across and down.
const GAP: usize = 3;
const GAP_DOWN: usize = 1;

/// Lines of a room: its frame, its name, and what is in it.
const ROOM_LINES: usize = 4;

/// Most lines of a drawing: a list says the same of larger buildings.
const LINES_MAX: usize = 120;

/// Edges of a cell that a line reaches.
const NORTH: u8 = 1;
const EAST: u8 = 2;
const SOUTH: u8 = 4;
const WEST: u8 = 8;

/// Signs for all sets of edges, in the order of their sums.
const LIGHT: &str = " ╵╶╰╷│╭├╴╯─┴╮┤┬┼";
const HEAVY: &str = " ╹╺┗╻┃┏┣╸┛━┻┓┫┳╋";

/// A drawing of a floor plan.
pub(crate) struct FloorCanvas {
    cells: Vec<Vec<(char, Tone)>>,
    xs: Vec<f32>,
    ys: Vec<f32>,
    room: usize,
}

/// A place in the drawing: column and line.
type Spot = (usize, usize);

impl FloorCanvas {
    /// Draws a plan; `None` if it has no room, or `columns` cells are too few for it.
    pub(crate) fn draw(plan: &FloorPlan, columns: usize) -> Option<Self> {
        let xs = distinct(plan.rooms.iter().map(|room| room.x));
        let ys = distinct(plan.rooms.iter().map(|room| room.y));
        let lines = ys.len() * (ROOM_LINES + GAP_DOWN);
        if xs.is_empty() || lines > LINES_MAX {
            return None;
        }
        let room = ((columns + GAP) / xs.len()).checked_sub(GAP)?.min(ROOM_MAX);
        if room < ROOM_MIN {
            return None;
        }
        let wide = xs.len() * (room + GAP);
        let cells = vec![vec![(' ', Tone::Plain); wide]; lines];
        let mut canvas = Self { cells, xs, ys, room };
        for way in &plan.ways {
            canvas.way(plan, &way.from, &way.to, Tone::Dim);
        }
        for robot in &plan.robots {
            let rooms: Vec<&String> = robot.room.iter().chain(&robot.path).collect();
            for pair in rooms.windows(2) {
                canvas.way(plan, pair[0], pair[1], Tone::Busy);
            }
        }
        plan.rooms.iter().for_each(|room| canvas.room(plan, room));
        Some(canvas)
    }

    /// Returns the cells that a drawing of this plan needs.
    pub(crate) fn columns_needed(plan: &FloorPlan) -> usize {
        let xs = distinct(plan.rooms.iter().map(|room| room.x));
        (xs.len() * (ROOM_MIN + GAP)).saturating_sub(GAP)
    }

    /// Returns the lines of the drawing.
    pub(crate) fn lines(&self) -> impl Iterator<Item = StyledLine> + '_ {
        self.cells.iter().map(|cells| {
            let mut line = StyledLine::default();
            for run in cells.chunk_by(|one, other| one.1 == other.1) {
                // The second half of a wide character is no cell of its own.
                let text = run.iter().filter(|(sign, _)| *sign != '\0').map(|(sign, _)| sign);
                line.push(&text.collect::<String>(), run.first().map_or(Tone::Plain, |it| it.1));
            }
            line
        })
    }

    /// Returns the left upper corner of a room.
    fn corner(&self, room: &FloorRoom) -> Spot {
        let index = |values: &[f32], value: f32| {
            values.iter().position(|it| it.total_cmp(&value).is_eq()).unwrap_or(0)
        };
        let (column, line) = (index(&self.xs, room.x), index(&self.ys, room.y));
        (column * (self.room + GAP), line * (ROOM_LINES + GAP_DOWN))
    }

    fn set(&mut self, (column, line): Spot, sign: char, tone: Tone) {
        if let Some(cell) = self.cells.get_mut(line).and_then(|cells| cells.get_mut(column)) {
            *cell = (sign, tone);
        }
    }

    /// Draws a way: out of one room into the space between the rooms, along it, and into the other.
    fn way(&mut self, plan: &FloorPlan, from: &str, to: &str, tone: Tone) {
        let find = |name: &str| plan.rooms.iter().find(|room| room.name == name);
        let (Some(from), Some(to)) = (find(from), find(to)) else { return };
        let (from, to) = (self.corner(from), self.corner(to));
        if from == to {
            return;
        }
        let (left, right) = if from.0 <= to.0 { (from, to) } else { (to, from) };
        let middle = |corner: Spot| (corner.0 + self.room / 2, corner.1 + ROOM_LINES / 2);
        let (one, other) = (middle(left), middle(right));
        let step = self.room + GAP;
        if one.1 == other.1 && other.0 - one.0 == step {
            self.across(one.1, one.0, other.0, tone);
        } else if one.1 == other.1 {
            // Below the rooms in between.
            let below = left.1 + ROOM_LINES;
            self.down(one.0, one.1, below, tone);
            self.across(below, one.0, other.0, tone);
            self.down(other.0, one.1, below, tone);
        } else if one.0 == other.0 {
            self.down(one.0, one.1, other.1, tone);
        } else {
            // Through the space to the left of the right room.
            let aisle = right.0.saturating_sub(2);
            self.across(one.1, one.0, aisle, tone);
            self.down(aisle, one.1, other.1, tone);
            self.across(other.1, aisle, other.0, tone);
        }
    }

    fn across(&mut self, line: usize, from: usize, to: usize, tone: Tone) {
        let (from, to) = (from.min(to), from.max(to));
        for column in from..to {
            self.stroke((column, line), EAST, tone);
            self.stroke((column + 1, line), WEST, tone);
        }
    }

    fn down(&mut self, column: usize, from: usize, to: usize, tone: Tone) {
        let (from, to) = (from.min(to), from.max(to));
        for line in from..to {
            self.stroke((column, line), SOUTH, tone);
            self.stroke((column, line + 1), NORTH, tone);
        }
    }

    /// Adds a line from the middle of a cell to one of its edges.
    fn stroke(&mut self, (column, line): Spot, edge: u8, tone: Tone) {
        let Some(cell) = self.cells.get_mut(line).and_then(|cells| cells.get_mut(column)) else {
            return;
        };
        let is_heavy = tone == Tone::Busy || cell.1 == Tone::Busy;
        let signs = if is_heavy { HEAVY } else { LIGHT };
        let edges = |sign: char| {
            let index = |signs: &str| signs.chars().position(|other| other == sign);
            index(LIGHT).or_else(|| index(HEAVY)).unwrap_or(0)
        };
        let edges = edges(cell.0) | usize::from(edge);
        let tone = if is_heavy { Tone::Busy } else { tone };
        *cell = (signs.chars().nth(edges).unwrap_or(' '), tone);
    }

    /// Draws the frame of a room, its name, and the robots and facts in it.
    fn room(&mut self, plan: &FloorPlan, room: &FloorRoom) {
        let (left, top) = self.corner(room);
        let tone = if room.is_stopped { Tone::Bad } else { Tone::Plain };
        let inside = self.room - 2;
        let edge = "─".repeat(inside);
        self.write((left, top), &format!("╭{edge}╮"), tone);
        self.write((left, top + ROOM_LINES - 1), &format!("╰{edge}╯"), tone);
        for line in top + 1..top + ROOM_LINES - 1 {
            self.write((left, line), &format!("│{}│", " ".repeat(inside)), tone);
        }
        let name = if room.is_stopped { format!("■ {}", room.name) } else { room.name.clone() };
        let name = text::cut(&text::clean(&name), inside);
        self.write((left + 1, top + 1), &name, Tone::Heading);
        let robots: Vec<_> = robots_in(plan, &room.name).map(mark).collect();
        let (inner, tone) = match (robots.is_empty(), room.is_stale) {
            (false, _) => (robots.join(" "), Tone::Busy),
            (true, true) => (room.facts.join(", "), Tone::Dim),
            (true, false) => (room.facts.join(", "), Tone::Plain),
        };
        self.write((left + 1, top + 2), &text::cut(&text::clean(&inner), inside), tone);
    }

    fn write(&mut self, (column, line): Spot, words: &str, tone: Tone) {
        let mut at = column;
        for sign in words.chars() {
            let width = text::width(sign.encode_utf8(&mut [0; 4]));
            // Accents have no cell of their own in a drawing.
            if width == 0 {
                continue;
            }
            self.set((at, line), sign, tone);
            (1..width).for_each(|next| self.set((at + next, line), '\0', tone));
            at += width;
        }
    }
}

/// Returns the robots that are in a room.
pub(crate) fn robots_in<'p>(
    plan: &'p FloorPlan,
    room: &'p str,
) -> impl Iterator<Item = &'p FloorRobot> {
    plan.robots.iter().filter(move |robot| robot.room.as_deref() == Some(room))
}

/// Returns the sign and name of a robot.
fn mark(robot: &FloorRobot) -> String {
    let sign = match (robot.is_stale, robot.moves_to.is_some()) {
        _ if robot.is_stopped => '■',
        (true, _) => '◇',
        (false, true) => '▶',
        (false, false) => '◆',
    };
    format!("{sign}{}", robot.agent)
}

/// Returns the different values, sorted.
fn distinct(values: impl Iterator<Item = f32>) -> Vec<f32> {
    let mut values: Vec<f32> = values.collect();
    values.sort_by(f32::total_cmp);
    values.dedup_by(|one, other| one.total_cmp(other).is_eq());
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(rooms: &[(&str, f32, f32)], ways: &[(&str, &str)]) -> FloorPlan {
        let room = |(name, x, y): &(&str, f32, f32)| FloorRoom {
            name: (*name).to_owned(),
            x: *x,
            y: *y,
            robots: Vec::new(),
            facts: Vec::new(),
            is_stale: false,
            is_stopped: false,
        };
        let way = |(from, to): &(&str, &str)| live_view::FloorWay {
            from: (*from).to_owned(),
            to: (*to).to_owned(),
            both_ways: true,
        };
        FloorPlan {
            rooms: rooms.iter().map(room).collect(),
            ways: ways.iter().map(way).collect(),
            ..FloorPlan::default()
        }
    }

    fn drawn(plan: &FloorPlan, columns: usize) -> Vec<String> {
        let canvas = FloorCanvas::draw(plan, columns).expect("room for it");
        canvas.lines().map(|line| line.text().trim_end().to_owned()).collect()
    }

    #[test]
    fn ways_lead_around_the_rooms_between() {
        let plan = plan(
            &[("a", 0.0, 0.0), ("b", 0.5, 0.0), ("c", 1.0, 0.0), ("d", 1.0, 1.0)],
            &[("a", "b"), ("a", "c"), ("a", "d")],
        );
        assert_eq!(
            drawn(&plan, 34),
            [
                "╭───────╮   ╭───────╮   ╭───────╮",
                "│a      │   │b      │   │c      │",
                "│       │───│       │─╮ │       │",
                "╰───────╯   ╰───────╯ │ ╰───────╯",
                "    ╰─────────────────┼─────╯",
                "                      │ ╭───────╮",
                "                      │ │d      │",
                "                      ╰─│       │",
                "                        ╰───────╯",
                "",
            ]
        );
    }

    #[test]
    fn a_plan_without_room_is_not_drawn() {
        let plan = plan(&[("a", 0.0, 0.0), ("b", 1.0, 0.0)], &[]);
        let needed = FloorCanvas::columns_needed(&plan);
        assert!(FloorCanvas::draw(&plan, needed).is_some());
        assert!(FloorCanvas::draw(&plan, needed - 1).is_none());
        assert!(FloorCanvas::draw(&FloorPlan::default(), 80).is_none());
    }

    #[test]
    fn odd_places_and_ways_are_no_problem() {
        let nan = f32::NAN;
        let odd = plan(
            &[
                ("a", nan, 0.0),
                ("b", -7.0, f32::INFINITY),
                ("a", nan, nan),
                ("厨房の灯り", 0.1, 0.2),
            ],
            &[("a", "a"), ("a", "unknown"), ("b", "a"), ("厨房の灯り", "b")],
        );
        for columns in 0..90 {
            if let Some(canvas) = FloorCanvas::draw(&odd, columns) {
                assert!(canvas.lines().all(|line| line.width() <= columns + GAP), "{columns}");
            }
        }
    }
}
