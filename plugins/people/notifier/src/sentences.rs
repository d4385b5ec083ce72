//! The texts of notices: a title, a sentence and a link. Texts are left out where `include-text` is
//! false, so that a locked screen shows no question, no goal and no name.

use serde_json::{Value, json};

use crate::notice::{Notice, NoticeDelivery, NoticeEvent, NoticeKind};

/// Maximum number of names in a sentence; the others are counted.
const NAMES_MAX: usize = 5;

/// Maximum number of notices that a summary lists; the others are counted.
const LISTED_MAX: usize = 20;

/// The form of a channel's notices.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct NoticeForm {
    /// Name of the ecosystem.
    pub(crate) ecosystem: String,
    /// Address of the page, without a path; `None` if there is no page.
    pub(crate) page: Option<String>,
    /// Whether questions, goals, reasons and names are left out.
    pub(crate) is_discreet: bool,
}

// === impl NoticeForm ===

impl NoticeForm {
    /// Returns the title of a delivery.
    pub(crate) fn title(&self, delivery: &NoticeDelivery) -> String {
        match delivery.notices.as_slice() {
            [notice] => self.title_of(notice),
            notices => format!("{} notices", notices.len()),
        }
    }

    /// Returns the text of a delivery: a sentence, or one line for each notice of a summary.
    pub(crate) fn text(&self, delivery: &NoticeDelivery) -> String {
        if let [notice] = delivery.notices.as_slice() {
            return self.text_of(notice);
        }
        let shown = delivery.notices.iter().take(LISTED_MAX);
        let line = |notice: &Notice| match self.text_of(notice) {
            text if text.is_empty() || self.is_discreet => self.title_of(notice),
            text => format!("{}: {text}", self.title_of(notice)),
        };
        let mut lines: Vec<_> = shown.map(line).collect();
        let more = delivery.notices.len().saturating_sub(LISTED_MAX);
        if more > 0 {
            lines.push(format!("and {more} more"));
        }
        lines.join("\n")
    }

    fn title_of(&self, notice: &Notice) -> String {
        let names = names(notice);
        match notice.kind {
            NoticeKind::Question if self.is_discreet => "A question".to_owned(),
            NoticeKind::Question => format!("{names} asks"),
            NoticeKind::GoalLost => "A goal has failed".to_owned(),
            NoticeKind::GoalLate => "A goal is late".to_owned(),
            NoticeKind::GoalLateSoon => "A goal will probably be late".to_owned(),
            NoticeKind::AgentGone if self.is_discreet => "An agent is gone".to_owned(),
            NoticeKind::AgentGone => format!("{names} {} gone", is_or_are(notice)),
            NoticeKind::AgentBack if self.is_discreet => "An agent is back".to_owned(),
            NoticeKind::AgentBack => format!("{names} {} back", is_or_are(notice)),
            NoticeKind::Stop => "Stop".to_owned(),
            NoticeKind::Release => "A stop is released".to_owned(),
        }
    }

    fn text_of(&self, notice: &Notice) -> String {
        if self.is_discreet {
            let link = self.page.as_ref().map(|_| "The page shows more.".to_owned());
            return link.unwrap_or_default();
        }
        let by = names(notice);
        match notice.kind {
            NoticeKind::Question
            | NoticeKind::GoalLost
            | NoticeKind::GoalLate
            | NoticeKind::GoalLateSoon => notice.text.clone(),
            NoticeKind::AgentGone => format!("{by} {} away for too long.", is_or_are(notice)),
            NoticeKind::AgentBack => format!("{by} {} here again.", is_or_are(notice)),
            NoticeKind::Stop => {
                let what = match notice.scope.as_slice() {
                    [] => "everything".to_owned(),
                    scope => listed(scope.iter().map(String::as_str)),
                };
                let why = match notice.text.as_str() {
                    "" => String::new(),
                    why => format!(": {why}"),
                };
                format!("{by} stops {what}{why}")
            }
            NoticeKind::Release if by.is_empty() => "Actuators may act again.".to_owned(),
            NoticeKind::Release => format!("{by} lets actuators act again."),
        }
    }

    /// Returns the address at which the page shows more; `None` if there is no page.
    pub(crate) fn link(&self, delivery: &NoticeDelivery) -> Option<String> {
        let page = self.page.as_ref()?;
        let path = match delivery.notices.as_slice() {
            [notice] => self.path_of(notice),
            _ => "/activity".to_owned(),
        };
        Some(format!("{page}{path}"))
    }

    fn path_of(&self, notice: &Notice) -> String {
        match (notice.kind, &notice.conversation, notice.agents.as_slice()) {
            (NoticeKind::Question, _, _) => "/questions".to_owned(),
            (kind, Some(id), _) if is_of_goal(kind) && !self.is_discreet => {
                format!("/goals/{}", encoded(id.as_str()))
            }
            (NoticeKind::GoalLost | NoticeKind::GoalLate | NoticeKind::GoalLateSoon, _, _) => {
                "/goals".to_owned()
            }
            (NoticeKind::AgentGone | NoticeKind::AgentBack, _, [agent]) if !self.is_discreet => {
                format!("/agents/{}", encoded(agent.as_str()))
            }
            (NoticeKind::AgentGone | NoticeKind::AgentBack, _, _) => "/agents".to_owned(),
            (NoticeKind::Stop | NoticeKind::Release, _, _) => "/".to_owned(),
        }
    }

    /// Returns a delivery for programs.
    pub(crate) fn json(&self, delivery: &NoticeDelivery) -> Value {
        let each = |notice: &Notice| {
            let mut told = json!({
                "id": notice.id,
                "kind": notice.kind.as_str(),
                "at": notice.at_ms,
                "ends": notice.ends_ms,
                "title": self.title_of(notice),
                "text": self.text_of(notice),
            });
            if !self.is_discreet {
                told["agents"] = json!(notice.agents);
                told["goal"] = json!(notice.conversation);
                told["scope"] = json!(notice.scope);
            }
            if let Some((keyboard, question)) = &notice.asked_at
                && !self.is_discreet
            {
                told["answer"] = json!({ "keyboard": keyboard, "question": question });
            }
            told
        };
        json!({
            "id": delivery.id,
            "ecosystem": self.ecosystem,
            "title": self.title(delivery),
            "text": self.text(delivery),
            "link": self.link(delivery),
            "notices": delivery.notices.iter().map(each).collect::<Vec<_>>(),
        })
    }
}

fn is_of_goal(kind: NoticeKind) -> bool {
    matches!(kind.event(), NoticeEvent::GoalLost | NoticeEvent::GoalLate)
}

fn names(notice: &Notice) -> String {
    listed(notice.agents.iter().map(acl::AgentId::as_str))
}

fn is_or_are(notice: &Notice) -> &'static str {
    if notice.agents.len() == 1 { "is" } else { "are" }
}

/// Returns names as a list: the first ones, and the number of the others.
fn listed<'n>(names: impl Iterator<Item = &'n str>) -> String {
    let mut shown: Vec<_> = names.collect();
    let more = shown.len().saturating_sub(NAMES_MAX);
    shown.truncate(NAMES_MAX);
    match more {
        0 => shown.join(", "),
        more => format!("{} and {more} more", shown.join(", ")),
    }
}

/// Returns a name as a part of the path of an address.
fn encoded(name: &str) -> String {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-_.~".contains(&byte);
    let each = name.bytes().map(|byte| match plain(byte) {
        true => char::from(byte).to_string(),
        false => format!("%{byte:02X}"),
    });
    each.collect()
}

#[cfg(test)]
mod tests {
    use acl::{AgentId, ConversationId};

    use super::*;

    fn form(is_discreet: bool) -> NoticeForm {
        let page = Some("https://hall:8443".to_owned());
        NoticeForm { ecosystem: "lab".to_owned(), page, is_discreet }
    }

    fn agent(name: &str) -> AgentId {
        AgentId::new(name).expect("a name")
    }

    fn alone(notice: Notice) -> NoticeDelivery {
        NoticeDelivery { id: notice.id.clone(), notices: vec![notice] }
    }

    fn question() -> Notice {
        let notice = Notice::new(NoticeKind::Question, "q", 1);
        notice.with_text("Whom do you visit?").with_agents(vec![agent("turtlebot-1")])
    }

    fn goal() -> Notice {
        let notice = Notice::new(NoticeKind::GoalLost, "c/1 ä", 1);
        let conversation = Some(ConversationId::new("c/1 ä"));
        Notice { conversation, ..notice }.with_text("(secret-visit ann)")
    }

    fn late(kind: NoticeKind) -> Notice {
        let conversation = Some(ConversationId::new("c2"));
        Notice { conversation, ..Notice::new(kind, "c2", 1) }.with_text("(secret-visit ann)")
    }

    fn gone(names: &[&str]) -> Notice {
        let agents = names.iter().map(|name| agent(name)).collect();
        Notice::new(NoticeKind::AgentGone, "a", 1).with_agents(agents)
    }

    fn stop() -> Notice {
        let notice = Notice::new(NoticeKind::Stop, "s", 1).with_text("fire alarm");
        let scope = vec!["office1".to_owned()];
        Notice { scope, ..notice }.with_agents(vec![agent("ann")])
    }

    #[test]
    fn notices_are_sentences_with_links() {
        for (notice, title, text, link) in [
            (question(), "turtlebot-1 asks", "Whom do you visit?", "/questions"),
            (goal(), "A goal has failed", "(secret-visit ann)", "/goals/c%2F1%20%C3%A4"),
            (late(NoticeKind::GoalLate), "A goal is late", "(secret-visit ann)", "/goals/c2"),
            (gone(&["ir-1"]), "ir-1 is gone", "ir-1 is away for too long.", "/agents/ir-1"),
            (gone(&["a", "b"]), "a, b are gone", "a, b are away for too long.", "/agents"),
            (stop(), "Stop", "ann stops office1: fire alarm", "/"),
        ] {
            let delivery = alone(notice);
            assert_eq!(form(false).title(&delivery), title);
            assert_eq!(form(false).text(&delivery), text);
            let link = format!("https://hall:8443{link}");
            assert_eq!(form(false).link(&delivery), Some(link));
        }
        let many = gone(&["a", "b", "c", "d", "e", "f", "g"]);
        assert_eq!(form(false).title(&alone(many)), "a, b, c, d, e and 2 more are gone");
        let without = NoticeForm { page: None, ..form(false) };
        assert_eq!(without.link(&alone(stop())), None);
    }

    #[test]
    fn a_discreet_notice_names_nothing_in_any_part() {
        let soon = late(NoticeKind::GoalLateSoon);
        let asked_at = Some((acl::AgentId::new("keyboard-office1").expect("a name"), 7));
        let asked = Notice { asked_at, ..question() };
        for notice in [question(), asked, goal(), soon, gone(&["ir-1"]), stop()] {
            let told = form(true).json(&alone(notice)).to_string();
            for part in ["turtlebot", "visit", "ann", "ir-1", "fire", "office1", "c%2F", "c/1"] {
                assert!(!told.contains(part), "{part}: {told}");
            }
        }
    }

    #[test]
    fn a_digest_lists_what_has_waited() {
        let notices: Vec<_> = (0..LISTED_MAX + 2).map(|_| goal()).collect();
        let summary = NoticeDelivery { id: "d".to_owned(), notices };
        assert_eq!(form(false).title(&summary), "22 notices");
        let text = form(false).text(&summary);
        assert!(text.starts_with("A goal has failed: (secret-visit ann)\n"), "{text}");
        assert!(text.ends_with("\nand 2 more"), "{text}");
        assert_eq!(form(false).link(&summary).as_deref(), Some("https://hall:8443/activity"));
        assert!(!form(true).text(&summary).contains("ann"));
    }
}
