//! The text of an ecosystem file, to which rooms, doors, agents and goals are added.

use toml_edit::{Document, Item, Table, TableLike};

use crate::addition::{AgentAddition, DoorAddition, EcosystemAddition, GoalAddition, RoomAddition};
use crate::edit_error::EditError;
use crate::insertion::{TextInsertion, item_end, line_at, line_of, own_keys_end};
use crate::setting::{SettingText, decimal, distinct, inline_table, key_text, quoted};
use crate::words::check_name;

const ROOMS: &str = "rooms";
const DOORS: &str = "doors";
const GOALS: &str = "goals";
const AGENT: &str = "agent";

/// Longest inline table of an agent's config, in characters; a longer one becomes a table of its
/// own.
const INLINE_CONFIG_CHARS_MAX: usize = 80;

/// The text of an ecosystem file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EcosystemText {
    text: String,
}

/// The text and its tables.
struct ParsedText<'t> {
    text: &'t str,
    document: Document<&'t str>,
}

// === impl EcosystemText ===

impl EcosystemText {
    /// Returns the text of a file, if it is valid TOML.
    ///
    /// # Errors
    ///
    /// Returns an error with the line that is not valid.
    pub fn parse(text: impl Into<String>) -> Result<EcosystemText, EditError> {
        let text = text.into();
        ParsedText::of(&text)?;
        Ok(EcosystemText { text })
    }

    /// Returns the text as it is now.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Adds one thing to the text, or leaves the text as it is.
    ///
    /// # Errors
    ///
    /// Returns an error if the name is impossible or taken, if the thing refers to a room that is
    /// not in the file, or if the file is written in a form to which nothing can be added.
    pub fn add(&mut self, addition: &EcosystemAddition) -> Result<(), EditError> {
        let parsed = ParsedText::of(&self.text)?;
        let insertion = match addition {
            EcosystemAddition::Room(room) => parsed.room(room)?,
            EcosystemAddition::Door(door) => parsed.door(door)?,
            EcosystemAddition::Agent(agent) => parsed.agent(agent)?,
            EcosystemAddition::Goal(goal) => parsed.goal(goal)?,
        };
        let text = insertion.applied_to(&self.text);
        match ParsedText::of(&text) {
            Ok(changed) if changed.has(addition) => (),
            Ok(_) => return Err(EditError::Broken("it is not found in the new text".to_owned())),
            Err(error) => return Err(EditError::Broken(error.to_string())),
        }
        self.text = text;
        Ok(())
    }

    /// Returns the names of the places in `[rooms]`, in the order of the file.
    pub fn rooms(&self) -> Vec<String> {
        let parsed = ParsedText::of(&self.text);
        parsed.map(|parsed| parsed.names(ROOMS)).unwrap_or_default()
    }

    /// Returns the names of the agents that the file names, in the order of the file.
    pub fn agents(&self) -> Vec<String> {
        let parsed = ParsedText::of(&self.text);
        parsed.map(|parsed| parsed.agent_names()).unwrap_or_default()
    }
}

// === impl ParsedText ===

impl<'t> ParsedText<'t> {
    fn of(text: &'t str) -> Result<ParsedText<'t>, EditError> {
        let document = Document::parse(text).map_err(|error| EditError::Toml {
            line: error.span().map_or(1, |span| line_at(text, span.start)),
            message: error.message().to_owned(),
        })?;
        Ok(ParsedText { text, document })
    }

    fn root(&self) -> &Table {
        self.document.as_table()
    }

    fn table(&self, name: &str) -> Option<&dyn TableLike> {
        self.root().get(name)?.as_table_like()
    }

    fn names(&self, table: &str) -> Vec<String> {
        let table = self.table(table);
        let names = table.into_iter().flat_map(|table| table.iter());
        names.map(|(name, _)| name.to_owned()).collect()
    }

    fn agent_tables(&self) -> impl Iterator<Item = &dyn TableLike> {
        let item = self.root().get(AGENT);
        let tables = item.and_then(Item::as_array_of_tables).into_iter().flat_map(|all| all.iter());
        let inline = item.and_then(Item::as_array).into_iter().flat_map(|all| all.iter());
        let inline = inline.filter_map(|value| value.as_inline_table());
        let inline = inline.map(|table| table as &dyn TableLike);
        tables.map(|table| table as &dyn TableLike).chain(inline)
    }

    fn agent_names(&self) -> Vec<String> {
        let names = self.agent_tables().filter_map(|table| table.get("name")?.as_str());
        names.map(str::to_owned).collect()
    }

    /// Whether the text has what was to be added.
    fn has(&self, addition: &EcosystemAddition) -> bool {
        match addition {
            EcosystemAddition::Room(room) => self.names(ROOMS).contains(&room.name),
            EcosystemAddition::Door(DoorAddition { from, to, .. }) => {
                self.way(from, to).or_else(|| self.way(to, from)).is_some()
            }
            EcosystemAddition::Agent(agent) => self.agent_names().contains(&agent.name),
            EcosystemAddition::Goal(goal) => self.names(GOALS).contains(&goal.name),
        }
    }

    /// Returns an error if the file has a map in PDDL.
    fn without_own_map(&self, what: &'static str) -> Result<(), EditError> {
        let ecosystem = self.table("ecosystem");
        let own = |key: &str| ecosystem.and_then(|table| table.get(key)?.as_str());
        match own("problem").or_else(|| own("domain")) {
            Some(file) if self.table(ROOMS).is_none() => {
                Err(EditError::OwnMap(file.to_owned(), what))
            }
            _ => Ok(()),
        }
    }

    /// Returns an error if a room or an agent is called `name`: both are objects of one problem.
    fn free_object(&self, name: &str) -> Result<(), EditError> {
        if let Some(rooms) = self.table(ROOMS).filter(|rooms| rooms.contains_key(name)) {
            let line = line_of(self.text, rooms, name);
            return Err(EditError::Taken { what: "a room", name: name.to_owned(), line });
        }
        let is_it = |table: &&dyn TableLike| {
            table.get("name").and_then(Item::as_str).is_some_and(|own| own == name)
        };
        match self.agent_tables().find(is_it) {
            Some(table) => {
                let line = line_of(self.text, table, "name");
                Err(EditError::Taken { what: "an agent", name: name.to_owned(), line })
            }
            None => Ok(()),
        }
    }

    fn known_room(&self, name: &str) -> Result<(), EditError> {
        let known = self.names(ROOMS);
        if known.iter().any(|room| room == name) {
            return Ok(());
        }
        let nearest = pddl::nearest(name, known.iter().map(String::as_str)).map(str::to_owned);
        Err(EditError::UnknownRoom { name: name.to_owned(), nearest, known })
    }

    fn room(&self, room: &RoomAddition) -> Result<TextInsertion, EditError> {
        self.without_own_map("room")?;
        check_name(&room.name, "a room")?;
        self.free_object(&room.name)?;
        self.entry(ROOMS, &["ecosystem"], &room.name, &inline_table(&room_settings(room)?))
    }

    fn door(&self, door: &DoorAddition) -> Result<TextInsertion, EditError> {
        let DoorAddition { from, to, is_one_way, .. } = door;
        self.without_own_map("door")?;
        if from == to {
            return Err(EditError::DoorToItself(from.clone()));
        }
        self.known_room(from)?;
        self.known_room(to)?;
        let there = self.way(from, to);
        let back = self.way(to, from).filter(|(_, is_back_only)| !(*is_one_way && *is_back_only));
        if let Some((line, _)) = there.or(back) {
            let name = format!("{from} – {to}");
            return Err(EditError::Taken { what: "a door", name, line });
        }
        let (first, second) = match (is_one_way, self.doors_of(from), self.doors_of(to)) {
            // Both ways are the same door, which is written where one of its rooms has doors
            // already.
            (false, None, Some(_)) => (to, from),
            _ => (from, to),
        };
        let entry = format!("{} = {}", key_text(second), door_value(door)?);
        match self.table(DOORS).and_then(|doors| doors.get(first)) {
            None => {
                let value = format!("{{ {entry} }}");
                self.entry(DOORS, &[ROOMS, "ecosystem"], first, &value)
            }
            Some(item) => {
                let form = || self.form(&format!("{DOORS}.{first}"), item);
                self.added_to_item(item, &entry).ok_or_else(form)
            }
        }
    }

    fn doors_of(&self, room: &str) -> Option<&dyn TableLike> {
        self.table(DOORS)?.get(room)?.as_table_like()
    }

    /// Returns the line of the way from a place to another as the file has it under the first, and
    /// whether it leads in this direction only.
    fn way(&self, from: &str, to: &str) -> Option<(usize, bool)> {
        let doors = self.doors_of(from);
        if let Some((doors, way)) = doors.and_then(|doors| Some((doors, doors.get(to)?))) {
            let is_one_way = way.as_table_like().and_then(|way| way.get("one-way")?.as_bool());
            return Some((line_of(self.text, doors, to), is_one_way == Some(true)));
        }
        None
    }

    fn agent(&self, agent: &AgentAddition) -> Result<TextInsertion, EditError> {
        check_name(&agent.name, "an agent")?;
        self.free_object(&agent.name)?;
        distinct(&agent.config)?;
        let text = agent_text(agent);
        match self.root().get(AGENT) {
            Some(item @ Item::ArrayOfTables(_)) => {
                let end = item_end(item).unwrap_or(self.text.len());
                Ok(TextInsertion::of_lines(self.text, end, &text, true))
            }
            Some(item) => Err(self.form(AGENT, item)),
            None => {
                let end = self.end_of_last(&[DOORS, ROOMS, "ecosystem"]);
                Ok(TextInsertion::of_lines(self.text, end, &text, true))
            }
        }
    }

    fn goal(&self, goal: &GoalAddition) -> Result<TextInsertion, EditError> {
        check_name(&goal.name, "a goal")?;
        if let Some(goals) = self.table(GOALS).filter(|goals| goals.contains_key(&goal.name)) {
            let line = line_of(self.text, goals, &goal.name);
            return Err(EditError::Taken { what: "a goal", name: goal.name.clone(), line });
        }
        let value = goal_value(goal)?;
        self.entry(GOALS, &[AGENT, DOORS, ROOMS, "ecosystem"], &goal.name, &value)
    }

    /// Returns the insertion of an entry at the end of a table at the top of the file. A table that
    /// is missing is written behind those of the parts `behind` that the file has.
    fn entry(
        &self,
        table: &'static str,
        behind: &[&str],
        name: &str,
        value: &str,
    ) -> Result<TextInsertion, EditError> {
        let entry = format!("{} = {value}", key_text(name));
        match self.root().get(table) {
            None => {
                let lines = format!("[{table}]\n{entry}\n");
                let end = self.end_of_last(behind);
                Ok(TextInsertion::of_lines(self.text, end, &lines, true))
            }
            Some(Item::Table(own)) if own.is_dotted() => {
                let end = own_keys_end(own).unwrap_or(self.text.len());
                Ok(TextInsertion::of_lines(self.text, end, &format!("{table}.{entry}\n"), false))
            }
            // Only subtables are written, such as [rooms.hall].
            Some(item @ Item::Table(own)) if own.is_implicit() => {
                let end = item_end(item).unwrap_or(self.text.len());
                let lines = format!("[{table}]\n{entry}\n");
                Ok(TextInsertion::of_lines(self.text, end, &lines, true))
            }
            Some(item) => self.added_to_item(item, &entry).ok_or_else(|| self.form(table, item)),
        }
    }

    /// Returns the insertion of an entry at the end of a table or of an inline table; `None` if the
    /// item is neither.
    fn added_to_item(&self, item: &Item, entry: &str) -> Option<TextInsertion> {
        match item {
            Item::Table(table) if !table.is_dotted() && !table.is_implicit() => {
                let end = own_keys_end(table)?;
                Some(TextInsertion::of_lines(self.text, end, &format!("{entry}\n"), false))
            }
            Item::Value(value) => {
                TextInsertion::of_entry(self.text, value.as_inline_table()?, entry)
            }
            _ => None,
        }
    }

    fn end_of_last(&self, parts: &[&str]) -> usize {
        let ends = parts.iter().filter_map(|part| item_end(self.root().get(part)?));
        ends.max().unwrap_or(self.text.len())
    }

    fn form(&self, part: &str, item: &Item) -> EditError {
        let line = item.span().map_or(1, |span| line_at(self.text, span.start));
        let (form, instead) = match part {
            AGENT => ("no list of [[agent]]", "the agent"),
            _ => ("no table to which a line can be added", "the entry"),
        };
        EditError::Form { part: part.to_owned(), line, form, instead }
    }
}

/// Returns the keys of a room, as they are written.
pub(crate) fn room_settings(room: &RoomAddition) -> Result<Vec<SettingText>, EditError> {
    let RoomAddition { kind, floor, area, settings, .. } = room;
    let mut all: Vec<_> = kind.iter().map(|kind| SettingText::text("kind", kind)).collect();
    all.extend(floor.map(|floor| SettingText::integer("floor", floor)));
    if let Some(area) = area {
        possible("an area", *area, "an area is a number above 0, in square meters")?;
        all.push(SettingText::number("area", *area));
    }
    all.extend(settings.iter().cloned());
    distinct(&all)?;
    Ok(all)
}

/// Returns the value of a door, as it is written.
pub(crate) fn door_value(door: &DoorAddition) -> Result<String, EditError> {
    if let Some(length) = door.length {
        possible("a length", length, "a length is a number above 0, in meters")?;
    }
    let length = door.length.map(|length| SettingText::number("length", length));
    match (door.is_one_way, door.length) {
        (false, Some(length)) => Ok(decimal(length)),
        _ => {
            let one_way = door.is_one_way.then(|| SettingText::flag("one-way"));
            let all: Vec<_> = length.into_iter().chain(one_way).collect();
            Ok(inline_table(&all))
        }
    }
}

fn possible(what: &'static str, value: f64, rule: &'static str) -> Result<(), EditError> {
    match value.is_finite() && value > 0.0 {
        true => Ok(()),
        false => Err(EditError::Number { what, value: value.to_string(), rule }),
    }
}

/// Returns the value of a goal: its text alone, or a table.
pub(crate) fn goal_value(goal: &GoalAddition) -> Result<String, EditError> {
    if !goal.is_kept && goal.settings.is_empty() {
        return Ok(quoted(&goal.goal));
    }
    let mut all = vec![SettingText::text("goal", &goal.goal)];
    if goal.is_kept {
        all.push(SettingText::text("keep", "maintain"));
        let has_time = |setting: &SettingText| {
            ["ask", "at", "by", "every", "on", "between", "until", "for"]
                .contains(&setting.key().as_str())
        };
        // A kept goal is asked for from the start, unless a setting says when.
        if !goal.settings.iter().any(has_time) {
            all.push(SettingText::text("ask", "always"));
        }
    }
    all.extend(goal.settings.iter().cloned());
    distinct(&all)?;
    Ok(inline_table(&all))
}

/// Returns the entry of an agent.
pub(crate) fn agent_text(agent: &AgentAddition) -> String {
    let AgentAddition { name, plugin, daemons, driver, config } = agent;
    let mut text = format!("[[agent]]\nname = {}\nplugin = {}\n", quoted(name), quoted(plugin));
    match daemons.as_slice() {
        [] => (),
        [one] => text += &format!("daemon = {}\n", quoted(one)),
        several => {
            let several: Vec<_> = several.iter().map(|daemon| quoted(daemon)).collect();
            text += &format!("daemon = [{}]\n", several.join(", "));
        }
    }
    if let Some(driver) = driver {
        text += &format!("driver = {}\n", quoted(driver));
    }
    if config.is_empty() {
        return text;
    }
    let inline = inline_table(config);
    if inline.chars().count() <= INLINE_CONFIG_CHARS_MAX {
        return text + &format!("config = {inline}\n");
    }
    text += "\n[agent.config]\n";
    for setting in config {
        text += &format!("{}\n", setting.line());
    }
    text
}
