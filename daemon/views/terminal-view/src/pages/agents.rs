//! The agents, and one of them with all that is known about it.

use live_view::{AgentDetail, AgentPresence, AgentRow, CurrentStep};

use super::{PageContext, activity, agent_link, duration_cell, world};
use crate::page::{PageAt, PageName};
use crate::sheet::{RowLink, RowSubject, Sheet};
use crate::styled_line::StyledLine;
use crate::table::{Table, TableCell, TableColumn};
use crate::time_words;
use crate::tone::Tone;

pub(super) fn sheet(agents: &[AgentRow], context: &PageContext) -> Sheet {
    let mut sheet = context.sheet();
    if agents.is_empty() {
        sheet.nothing("No agent was seen yet. `althing up ECOSYSTEM.toml` starts some.");
    }
    let mut table = Table::new(vec![
        TableColumn::new("AGENT", 0, 19, 30),
        TableColumn::new("STATE", 1, 9, 10),
        TableColumn::new("DOING", 2, 18, 50),
        TableColumn::right("FOR", 4, 6, 10),
        TableColumn::right("LATE", 5, 6, 10),
        TableColumn::new("PROBLEM", 3, 18, 60),
        TableColumn::new("DAEMON", 6, 8, 16),
        TableColumn::right("BEAT", 7, 6, 10),
        TableColumn::right("MAIL", 8, 4, 6),
        TableColumn::new("OFFERS", 9, 12, 60),
    ]);
    for agent in context.bounded(agents, |agent| agent.agent.to_string()) {
        let daemon = agent.daemon.as_ref().map(ToString::to_string).unwrap_or_default();
        let replicas =
            if agent.replicas > 1 { format!(" ×{}", agent.replicas) } else { String::new() };
        let waiting = agent.waiting.filter(|waiting| *waiting > 0);
        let cells = vec![
            TableCell::of(agent.agent.as_str(), Tone::Name),
            TableCell::Line(presence(agent)),
            TableCell::of(agent.doing.as_deref().unwrap_or_default(), Tone::Plain),
            duration_cell(agent.doing_since.map(|since| context.now.since(since)), Tone::Dim),
            duration_cell(agent.late_ms, Tone::Warn),
            TableCell::of(&agent.problems.join("; "), Tone::Warn),
            TableCell::of(&format!("{daemon}{replicas}"), Tone::Dim),
            duration_cell(agent.heartbeat_age_ms, Tone::Dim),
            TableCell::of(&waiting.map(|it| it.to_string()).unwrap_or_default(), Tone::Dim),
            TableCell::of(&agent.actions.join(" "), Tone::Dim),
        ];
        table.row(cells, agent_link(agent.agent.as_str()));
    }
    table.draw(&mut sheet);
    context.say_left_out(&mut sheet, agents.len());
    sheet
}

/// Returns the sign and word of an agent's presence.
fn presence(agent: &AgentRow) -> StyledLine {
    let (text, tone) = match agent.presence {
        _ if agent.is_stopped => ("■ stopped", Tone::Bad),
        AgentPresence::Present if agent.doing.is_some() => ("▶ busy", Tone::Busy),
        AgentPresence::Present => ("✓ present", Tone::Good),
        AgentPresence::Silent => ("! silent", Tone::Warn),
        AgentPresence::Gone => ("✗ gone", Tone::Bad),
        AgentPresence::Absent => ("✗ absent", Tone::Bad),
        AgentPresence::Unknown => ("? unknown", Tone::Dim),
    };
    StyledLine::of(text, tone)
}

/// Makes the page of one agent.
pub(super) fn detail(detail: &AgentDetail, context: &PageContext) -> Sheet {
    let mut sheet = context.sheet();
    head(&mut sheet, detail, context);
    for (number, step) in detail.running.iter().enumerate() {
        running(&mut sheet, step, number, context);
    }
    replicas(&mut sheet, detail, context);
    sheet.heading("Actions");
    if detail.actions.is_empty() {
        sheet.nothing("It offers no actions, or its action model was not observed.");
    }
    actions(detail).draw(&mut sheet);
    if !detail.facts.is_empty() {
        sheet.heading("Facts that it answers for");
        let facts = context.bounded(&detail.facts, |fact| fact.fact.clone());
        world::table(&facts, context).draw(&mut sheet);
    }
    if !detail.recent.is_empty() {
        sheet.heading("What it did last");
    }
    for entry in &detail.recent {
        activity::row(&mut sheet, entry, context);
    }
    if let Some(model) = &detail.model {
        sheet.heading("Action model");
        for (number, line) in model.lines().enumerate() {
            let link = RowLink {
                key: format!("model {number}"),
                copies: model.clone(),
                ..RowLink::default()
            };
            sheet.row(StyledLine::of(line, Tone::Dim), line.to_owned(), link);
        }
    }
    sheet
}

fn head(sheet: &mut Sheet, detail: &AgentDetail, context: &PageContext) {
    let row = &detail.row;
    let mut line = StyledLine::of(row.agent.as_str(), Tone::Name).and("  ", Tone::Plain);
    line.append(presence(row));
    if let Some(since) = row.since {
        line.push(&format!(" for {}", context.ago(since)), Tone::Dim);
    }
    if let Some(daemon) = &row.daemon {
        line.push(&format!(", on {daemon}"), Tone::Dim);
    }
    let link = RowLink { opens: None, key: "agent".to_owned(), ..agent_link(row.agent.as_str()) };
    sheet.wrapped_row(&line, 2, link);
    let mut beats = Vec::new();
    if let Some(age) = row.heartbeat_age_ms {
        beats.push(format!("last heartbeat {} ago", time_words::duration(age)));
    }
    if let Some(period) = detail.heartbeat_period_ms {
        beats.push(format!("one every {}", time_words::duration(period)));
    }
    if let Some(mailbox) = &detail.mailbox {
        beats.push(format!(
            "mailbox: {} messages received, {} wait now, at most {} waited, {} did not fit",
            mailbox.received, mailbox.waiting, mailbox.waiting_max, mailbox.overflowed
        ));
    }
    if !beats.is_empty() {
        sheet.text(&StyledLine::of(&beats.join("; "), Tone::Dim), 2);
    }
    for problem in &row.problems {
        sheet.text(&StyledLine::of("! ", Tone::Warn).and(problem, Tone::Plain), 2);
    }
    for stop in &detail.stops {
        let why = if stop.why.is_empty() { String::new() } else { format!(": {}", stop.why) };
        let text = format!("stopped by {}{why} (stop {})", stop.by, stop.id);
        sheet.text(&StyledLine::of("■ ", Tone::Bad).and(&text, Tone::Plain), 2);
    }
    if let Some(found) = &detail.discovered {
        let joined = if found.joined { "takes part" } else { "does not take part" };
        let why = found.problem.as_ref().map(|why| format!(": {why}")).unwrap_or_default();
        let text = format!("discovered by {}; {joined}{why}", found.by);
        sheet.text(&StyledLine::of(&text, Tone::Plain), 2);
    }
}

fn running(sheet: &mut Sheet, step: &CurrentStep, number: usize, context: &PageContext) {
    let mut line = StyledLine::of("▶ ", Tone::Busy).and(&step.text, Tone::Plain);
    line.push(&format!(", for {}", context.ago(step.started_at)), Tone::Dim);
    if let Some(usual) = step.usual_ms {
        line.push(&format!(" of about {}", time_words::duration(usual)), Tone::Dim);
    }
    if let Some(late) = step.late_ms {
        line.push(&format!(", {} late", time_words::duration(late)), Tone::Warn);
    }
    if !step.detail.is_empty() {
        line.push(&format!(" ({})", step.detail), Tone::Dim);
    }
    let goal = step.conversation.as_ref().map(ToString::to_string);
    let link = RowLink {
        key: format!("running {number}"),
        opens: goal.map(|goal| PageAt::named(PageName::Goal, goal)),
        copies: step.step.clone(),
        about: RowSubject::Statement(step.step.clone()),
        ..RowLink::default()
    };
    sheet.wrapped_row(&line, 2, link);
}

fn replicas(sheet: &mut Sheet, detail: &AgentDetail, context: &PageContext) {
    if detail.replicas.len() < 2 {
        return;
    }
    sheet.heading("Replicas");
    for replica in &detail.replicas {
        let (sign, word) = match replica.leads {
            Some(true) => ("★", "leads"),
            Some(false) => ("☆", "stands by"),
            None => ("?", "leads or stands by"),
        };
        let text = format!("{sign} {} {word}, for {}", replica.daemon, context.ago(replica.since));
        sheet.text(&StyledLine::of(&text, Tone::Plain), 2);
    }
}

fn actions(detail: &AgentDetail) -> Table {
    let mut table = Table::new(vec![
        TableColumn::new("ACTION", 0, 12, 30),
        TableColumn::new("OFFERED", 1, 9, 11),
        TableColumn::right("USUAL", 2, 6, 10),
        TableColumn::right("RUNS", 3, 4, 6),
        TableColumn::right("FAILED", 4, 6, 6),
        TableColumn::new("PARAMETERS", 5, 12, 60),
    ]);
    for action in &detail.actions {
        let offered = if action.is_offered {
            TableCell::of("✓ now", Tone::Good)
        } else {
            TableCell::of("– withdrawn", Tone::Warn)
        };
        let some = |number: u64| if number > 0 { number.to_string() } else { String::new() };
        let link = RowLink {
            key: format!("action {}", action.action),
            copies: action.action.clone(),
            ..RowLink::default()
        };
        let cells = vec![
            TableCell::of(&action.action, Tone::Plain),
            offered,
            duration_cell(action.usual_ms, Tone::Plain),
            TableCell::of(&some(action.runs), Tone::Dim),
            TableCell::of(&some(action.failures), Tone::Warn),
            TableCell::of(&action.parameters, Tone::Dim),
        ];
        table.row(cells, link);
    }
    table
}
