//! Checks the file of people: its form, its permissions, and names that agents have, too.

use std::io;

use accounts::{AccountsError, PeopleFile, PeopleText, PersonRecord};
use pddl::{Diagnostic, Span, nearest};
use terminal::report::SourceText;

use super::Reviewer;

impl Reviewer<'_> {
    /// Reports the mistakes in the file of people.
    pub(super) fn people(&mut self) {
        let file = PeopleFile::new(&self.ecosystem.people);
        let text = match file.text() {
            Ok(Some(text)) => text,
            Ok(None) => return self.missing_people(),
            Err(AccountsError::Io { path, source })
                if source.kind() == io::ErrorKind::PermissionDenied =>
            {
                let shown = path.display();
                let message = format!("{shown} is not checked: this user may not read it");
                return self.report_people(Diagnostic::warning(Span::default(), message));
            }
            Err(error) => {
                let message = format!("failed to {error}");
                return self.report_people(Diagnostic::error(Span::default(), message));
            }
        };
        let mut read = accounts::read_people(&text);
        for entry in &self.ecosystem.agents {
            if let Some(span) = read.places.get(entry.name.as_str()) {
                let message = format!("there is an agent called `{}`", entry.name);
                let help = "give the person another name: messages name both";
                read.mistakes.push(Diagnostic::error(*span, message).with_help(help));
            }
        }
        let screens = self.screens_without_agents(&read);
        read.mistakes.extend(screens);
        // An excerpt of the text must not show hashes.
        let shown = accounts::without_secrets(&text);
        let source = SourceText::new(file.path().display().to_string(), shown);
        self.report.add(&source, read.mistakes);
    }

    /// Finds the screens of agents that the ecosystem file does not have.
    fn screens_without_agents(&self, read: &PeopleText) -> Vec<Diagnostic> {
        let names = || self.ecosystem.agents.iter().map(|entry| entry.name.as_str());
        let missing = |record: &PersonRecord| {
            let agent = record.screen.as_deref()?;
            let span = *read.screen_places.get(&record.name)?;
            if names().any(|name| name == agent) {
                return None;
            }
            let message = format!("no agent of {} is called `{agent}`", self.ecosystem.name);
            let help = match nearest(agent, names()) {
                Some(near) => format!("did you mean `{near}`?"),
                None => format!("the screen shows nothing until an agent `{agent}` joins"),
            };
            Some(Diagnostic::warning(span, message).with_help(help))
        };
        read.records.iter().filter_map(missing).collect()
    }

    fn missing_people(&mut self) {
        if self.ecosystem.is_people_file_named {
            let shown = self.ecosystem.people.display();
            let message = format!("there is no {shown}, so nobody can sign in");
            let help = "add a person: althing people add NAME --role operator";
            self.report_people(Diagnostic::warning(Span::default(), message).with_help(help));
        }
    }

    /// Reports a mistake at the place in the ecosystem file that names the file of people.
    fn report_people(&mut self, found: Diagnostic) {
        self.report_value("people.file", found);
    }
}
