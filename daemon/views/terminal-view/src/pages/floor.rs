//! The floor plan: a drawing, and a list that says the same.

use live_view::{FloorPlan, FloorRobot, FloorRoom};

use super::{PageContext, count};
use crate::floor_canvas::{FloorCanvas, robots_in};
use crate::page::{PageAt, PageName};
use crate::sheet::{RowLink, RowSubject, Sheet};
use crate::styled_line::StyledLine;
use crate::table::{Table, TableCell, TableColumn};
use crate::tone::Tone;

pub(super) fn sheet(plan: &FloorPlan, context: &PageContext) -> Sheet {
    let mut sheet = context.sheet();
    if plan.rooms.is_empty() {
        let why = match plan.empty_because.as_str() {
            "" => "No place is known yet: places are what robots move between.",
            why => why,
        };
        sheet.nothing(why);
    }
    match FloorCanvas::draw(plan, sheet.columns()) {
        Some(canvas) => canvas.lines().for_each(|line| sheet.drawing(line)),
        None if plan.rooms.is_empty() => (),
        None => {
            let needed = FloorCanvas::columns_needed(plan);
            sheet.drawing(
                StyledLine::of(&format!("(the drawing needs {needed} columns)"), Tone::Dim)
                    .fit(sheet.columns()),
            );
        }
    }
    for robot in &plan.robots {
        robot_row(&mut sheet, robot);
    }
    sheet.gap();
    let mut table = Table::new(vec![
        TableColumn::new("PLACE", 0, 10, 24),
        TableColumn::new("ROBOTS", 1, 8, 30),
        TableColumn::new("FACTS", 2, 10, 60),
        TableColumn::new("LEADS TO", 3, 10, 60),
    ]);
    for room in &plan.rooms {
        table.row(cells(plan, room, context), link(plan, room));
    }
    table.draw(&mut sheet);
    if plan.more_rooms > 0 {
        sheet.nothing(&format!("and {} more", count(plan.more_rooms, "place")));
    }
    sheet
}

fn robot_row(sheet: &mut Sheet, robot: &FloorRobot) {
    let (sign, tone) = if robot.is_stopped { ("■ ", Tone::Bad) } else { ("◆ ", Tone::Busy) };
    let mut line = StyledLine::of(sign, tone).and(robot.agent.as_str(), Tone::Name);
    let place = match &robot.room {
        Some(room) => format!(" is in {room}"),
        None => " is in an unknown place".to_owned(),
    };
    line.push(&place, Tone::Plain);
    if let Some(to) = &robot.moves_to {
        line.push(&format!(" and moves to {to}"), Tone::Busy);
    }
    if robot.path.len() > 1 {
        line.push(&format!(", by {}", robot.path.join(", ")), Tone::Plain);
    }
    if robot.is_stopped {
        line.push(" (stopped)", Tone::Bad);
    }
    if robot.is_stale {
        line.push(" (gone or silent: its place may be wrong)", Tone::Warn);
    }
    let agent = robot.agent.to_string();
    let goal = robot.conversation.as_ref().map(ToString::to_string);
    let opens = match goal {
        Some(goal) => PageAt::named(PageName::Goal, goal),
        None => PageAt::named(PageName::Agent, agent.as_str()),
    };
    let link = RowLink {
        key: format!("robot {agent}"),
        opens: Some(opens),
        copies: agent.clone(),
        about: RowSubject::Agent(agent),
        ..RowLink::default()
    };
    sheet.wrapped_row(&line, 2, link);
}

fn cells(plan: &FloorPlan, room: &FloorRoom, context: &PageContext) -> Vec<TableCell> {
    let robots: Vec<_> = room.robots.iter().map(|robot| robot.as_str()).collect();
    let stopped = if room.is_stopped { "■ " } else { "" };
    let ways = plan.ways.iter().filter_map(|way| {
        let (from, to) = (way.from.as_str(), way.to.as_str());
        match (from == room.name, to == room.name) {
            (true, _) => Some(to),
            (false, true) if way.both_ways => Some(from),
            _ => None,
        }
    });
    let facts = if room.is_stale { Tone::Dim } else { Tone::Plain };
    vec![
        TableCell::Line(StyledLine::of(stopped, Tone::Bad).and(&room.name, Tone::Name)),
        TableCell::of(&robots.join(", "), Tone::Busy),
        TableCell::of(&context.said(&room.facts.join(", ")), facts),
        TableCell::of(&ways.collect::<Vec<_>>().join(", "), Tone::Dim),
    ]
}

fn link(plan: &FloorPlan, room: &FloorRoom) -> RowLink {
    let robot = robots_in(plan, &room.name).next();
    let opens = robot.map(|robot| PageAt::named(PageName::Agent, robot.agent.to_string()));
    RowLink {
        key: format!("room {}", room.name),
        opens,
        copies: room.name.clone(),
        about: RowSubject::Nothing,
        ..RowLink::default()
    }
}
