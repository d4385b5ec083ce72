//! Reads the file of a definition, and derives the messages of services and actions from it.

use std::collections::BTreeSet;

use crate::errors::{DefinitionError, DefinitionMistake, shortened};
use crate::grammar::{GrammarMistake, Statement, statement};
use crate::names;
use crate::structure::{
    FieldArity, FieldElement, MessageField, MessageStructure, PrimitiveType, StructureRole,
};

/// Structures with their full names.
pub(crate) type NamedStructures = Vec<(String, MessageStructure)>;

/// Returns the structures that a file defines: that of a message, or those that ROS derives from a
/// service or an action.
pub(crate) fn read(
    package: &str,
    file_name: &str,
    text: &str,
) -> Result<NamedStructures, DefinitionError> {
    let failed = |mistakes| DefinitionError { file: format!("{package}/{file_name}"), mistakes };
    let (name, kind) = names_of(package, file_name).map_err(|mistake| failed(vec![mistake]))?;
    let (sections, mut mistakes) = sections(package, text);
    mistakes.extend(wrong_count(kind, text, &sections));
    if !mistakes.is_empty() {
        mistakes.sort_by_key(|mistake| (mistake.line, mistake.column));
        return Err(failed(mistakes));
    }
    let base = format!("{package}/{kind}/{name}");
    let mut parts = sections.into_iter().map(|section| section.structure);
    let mut next = || parts.next().unwrap_or(empty());
    Ok(match kind {
        "srv" => service(&base, next(), next()),
        "action" => action(&base, next(), next(), next()),
        _ => vec![(base, next())],
    })
}

/// Returns the name and the kind of a definition, such as `Pose` and `msg`, from the name of its
/// file. Returns a mistake if the name of the package or of the file is not allowed.
fn names_of<'a>(
    package: &str,
    file_name: &'a str,
) -> Result<(&'a str, &'a str), DefinitionMistake> {
    let mistake = |found: &str, problem: &str| {
        let (found, problem) = (shortened(found), problem.to_owned());
        DefinitionMistake { line: 0, column: 0, found, problem }
    };
    if !names::is_package(package) {
        let problem = "the name of a package has small letters, digits and single underscores, \
                       and begins with a letter";
        return Err(mistake(package, problem));
    }
    let (name, kind) = file_name.rsplit_once('.').unwrap_or((file_name, ""));
    if !["msg", "srv", "action"].contains(&kind) {
        return Err(mistake(file_name, "a definition is a file `.msg`, `.srv` or `.action`"));
    }
    if !names::is_plain_type(name) {
        let problem = "the name of a definition has letters and digits, and begins with a capital \
                       letter";
        return Err(mistake(file_name, problem));
    }
    Ok((name, kind))
}

/// A part of a file, before, between or after its separators.
struct FileSection {
    structure: MessageStructure,
    /// Line of the separator before the section, from 1; 0 for the first section.
    begin: usize,
}

fn empty() -> MessageStructure {
    MessageStructure::new(StructureRole::Message, Vec::new())
}

/// Returns the sections of a file, and the mistakes of its lines.
fn sections(package: &str, text: &str) -> (Vec<FileSection>, Vec<DefinitionMistake>) {
    let mut sections = Vec::new();
    let mut section = FileSection { structure: empty(), begin: 0 };
    let mut names = BTreeSet::new();
    let mut mistakes = Vec::new();
    for (index, line) in lines(text).enumerate() {
        let structure = &mut section.structure;
        let is_new = match statement(line, package) {
            Ok(Statement::Blank) => true,
            Ok(Statement::Separator) => {
                names.clear();
                let next = FileSection { structure: empty(), begin: index + 1 };
                sections.push(std::mem::replace(&mut section, next));
                true
            }
            Ok(Statement::Field(mut field)) => {
                field.place = (index + 1, column(line, line.trim_start()));
                let is_new = names.insert(field.name.clone());
                structure.fields.push(field);
                is_new
            }
            Ok(Statement::Constant(name, value)) => {
                let is_new = names.insert(name.clone());
                structure.constants.insert(name, value);
                is_new
            }
            Err(mistake) => {
                mistakes.push(placed(index + 1, line, mistake));
                true
            }
        };
        if !is_new {
            let at = line.trim_start();
            let problem = "the name is taken by an earlier line; names are unique".to_owned();
            mistakes.push(placed(index + 1, line, GrammarMistake { at, found: at, problem }));
        }
    }
    sections.push(section);
    (sections, mistakes)
}

/// Returns the lines of a file, without a byte order mark.
fn lines(text: &str) -> std::str::Lines<'_> {
    text.strip_prefix('\u{feff}').unwrap_or(text).lines()
}

/// Returns the column at which the rest of a line begins.
fn column(line: &str, rest: &str) -> usize {
    // The rest has no comment, so the places are compared, and not the lengths.
    let offset = (rest.as_ptr() as usize).saturating_sub(line.as_ptr() as usize);
    line.get(..offset).map_or(0, |before| before.chars().count()) + 1
}

fn placed(line_number: usize, line: &str, mistake: GrammarMistake<'_>) -> DefinitionMistake {
    DefinitionMistake {
        line: line_number,
        column: column(line, mistake.at),
        found: shortened(mistake.found.trim_end()),
        problem: mistake.problem,
    }
}

/// Returns the mistake of a file that has too few or too many separators.
fn wrong_count(kind: &str, text: &str, sections: &[FileSection]) -> Option<DefinitionMistake> {
    let (count, problem) = match kind {
        "srv" => (2, "a service has one line `---`, between request and response"),
        "action" => (3, "an action has two lines `---`, between goal, result and feedback"),
        _ => (1, "a message has no line `---`; services and actions have"),
    };
    let line = match sections.get(count) {
        Some(surplus) => surplus.begin,
        None if sections.len() < count => lines(text).count().max(1),
        None => return None,
    };
    let found = lines(text).nth(line - 1).map(str::trim).unwrap_or_default();
    let (found, problem) = (shortened(found), problem.to_owned());
    Some(DefinitionMistake { line, column: 1, found, problem })
}

// === what ROS derives ===

/// Returns the structures of a service: the messages, the event that records a call, and the
/// service itself.
fn service(base: &str, request: MessageStructure, response: MessageStructure) -> NamedStructures {
    let [request_name, response_name, event_name] =
        ["Request", "Response", "Event"].map(|part| format!("{base}_{part}"));
    let recorded = |name: &str, nested: &str| {
        let element = FieldElement::Nested(nested.to_owned());
        MessageField::added(name, element, FieldArity::BoundedSequence(1))
    };
    let event = vec![
        MessageField::nested("info", "service_msgs/msg/ServiceEventInfo"),
        recorded("request", &request_name),
        recorded("response", &response_name),
    ];
    let members = vec![
        MessageField::nested("request_message", &request_name),
        MessageField::nested("response_message", &response_name),
        MessageField::nested("event_message", &event_name),
    ];
    vec![
        (request_name, request),
        (response_name, response),
        (event_name, MessageStructure::new(StructureRole::Message, event)),
        (base.to_owned(), MessageStructure::new(StructureRole::Service, members)),
    ]
}

/// Returns the structures of an action: its parts, the two services by which a goal is sent and its
/// result is fetched, the message of its feedback, and the action itself.
fn action(
    base: &str,
    goal: MessageStructure,
    result: MessageStructure,
    feedback: MessageStructure,
) -> NamedStructures {
    let name = |part: &str| format!("{base}_{part}");
    let message = |fields| MessageStructure::new(StructureRole::Message, fields);
    let goal_id = || MessageField::nested("goal_id", "unique_identifier_msgs/msg/UUID");
    let primitive = |name: &str, primitive| {
        MessageField::added(name, FieldElement::Primitive(primitive), FieldArity::One)
    };
    let sent = message(vec![goal_id(), MessageField::nested("goal", &name("Goal"))]);
    let accepted = message(vec![
        primitive("accepted", PrimitiveType::Bool),
        MessageField::nested("stamp", "builtin_interfaces/msg/Time"),
    ]);
    let ended = message(vec![
        primitive("status", PrimitiveType::Int8),
        MessageField::nested("result", &name("Result")),
    ]);
    let reported = message(vec![goal_id(), MessageField::nested("feedback", &name("Feedback"))]);
    let members = [
        ("goal", "Goal"),
        ("result", "Result"),
        ("feedback", "Feedback"),
        ("send_goal_service", "SendGoal"),
        ("get_result_service", "GetResult"),
        ("feedback_message", "FeedbackMessage"),
    ];
    let members = members.map(|(member, part)| MessageField::nested(member, &name(part)));
    let mut structures = vec![
        (name("Goal"), goal),
        (name("Result"), result),
        (name("Feedback"), feedback),
        (name("FeedbackMessage"), reported),
        (base.to_owned(), MessageStructure::new(StructureRole::Action, members.to_vec())),
    ];
    structures.extend(service(&name("SendGoal"), sent, accepted));
    structures.extend(service(&name("GetResult"), message(vec![goal_id()]), ended));
    structures
}
