//! Topics of ntfy, and of servers that take the same requests: a `POST` of JSON to the server, which
//! shows the notice on telephones. A question may bring buttons that answer it.

use serde_json::{Value, json};

use crate::address::ReceiverAddress;
use crate::channel_secret::ChannelSecret;
use crate::http::{PostRequest, post};
use crate::notice::{Notice, NoticeDelivery, NoticeKind};
use crate::send_failure::SendFailure;
use crate::sentences::NoticeForm;
use crate::trust::ReceiverTrust;

/// Maximum number of buttons of a notice, as ntfy has it.
const BUTTONS_MAX: usize = 3;

/// Longest text that ntfy shows as text, in bytes; it makes a file of a longer one.
const TEXT_BYTES_MAX: usize = 4_000;

/// Buttons that answer questions.
#[derive(Clone, Debug)]
pub(crate) struct AnswerButtons {
    /// The answers, in the order of the buttons.
    pub(crate) answers: Vec<String>,
    /// Token of a program that may answer; it travels with each question.
    pub(crate) token: ChannelSecret,
}

/// A topic of a server.
pub(crate) struct NtfyTopic {
    /// The server, without the topic.
    server: ReceiverAddress,
    topic: String,
    trust: ReceiverTrust,
    token: Option<ChannelSecret>,
    buttons: Option<AnswerButtons>,
}

// === impl NtfyTopic ===

impl NtfyTopic {
    /// Creates the topic of an address such as `https://ntfy.example/building`.
    ///
    /// # Errors
    ///
    /// Returns the reason as a text for a person, which does not repeat the topic.
    pub(crate) fn new(
        address: ReceiverAddress,
        trust: ReceiverTrust,
        token: Option<ChannelSecret>,
        buttons: Option<AnswerButtons>,
    ) -> Result<NtfyTopic, &'static str> {
        let topic = address.path.trim_matches('/').to_owned();
        let is_name = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if topic.is_empty() || topic.len() > 64 || !topic.chars().all(is_name) {
            return Err("it must end with one topic of at most 64 letters, digits, `-` and `_`, \
                        such as https://ntfy.example/building-7fK2");
        }
        if buttons.as_ref().is_some_and(|buttons| buttons.answers.len() > BUTTONS_MAX) {
            return Err("a notice has at most 3 buttons");
        }
        let server = ReceiverAddress { path: "/".to_owned(), ..address };
        Ok(NtfyTopic { server, topic, trust, token, buttons })
    }

    /// Sends a delivery once.
    pub(crate) async fn send(
        &self,
        delivery: &NoticeDelivery,
        form: &NoticeForm,
    ) -> Result<(), SendFailure> {
        let body = self.body(delivery, form).to_string().into_bytes();
        let mut headers = vec![("Content-Type", "application/json".to_owned())];
        if let Some(token) = &self.token {
            headers.push(("Authorization", format!("Bearer {}", token.reveal())));
        }
        let (address, trust) = (&self.server, &self.trust);
        post(PostRequest { address, trust, headers, body }).await?.judge()
    }

    fn body(&self, delivery: &NoticeDelivery, form: &NoticeForm) -> Value {
        let mut text = form.text(delivery);
        while text.len() > TEXT_BYTES_MAX {
            text.pop();
        }
        let (priority, tag) = match delivery.notices.as_slice() {
            [notice] => look(notice.kind),
            _ => (3, "bell"),
        };
        let mut body = json!({
            "topic": self.topic,
            "title": form.title(delivery),
            "message": text,
            "priority": priority,
            "tags": [tag],
        });
        if let Some(link) = form.link(delivery) {
            body["click"] = json!(link);
            body["actions"] = self.actions(delivery, form, &link);
        }
        body
    }

    /// Returns the buttons: those that answer a question, or else one that opens the page.
    fn actions(&self, delivery: &NoticeDelivery, form: &NoticeForm, link: &str) -> Value {
        let opens = json!([{ "action": "view", "label": "Open", "url": link, "clear": true }]);
        let [Notice { asked_at: Some((keyboard, question)), .. }] = delivery.notices.as_slice()
        else {
            return opens;
        };
        let (Some(buttons), Some(page), false) = (&self.buttons, &form.page, form.is_discreet)
        else {
            return opens;
        };
        let each = buttons.answers.iter().map(|answer| {
            let act = json!({
                "act": "answer", "keyboard": keyboard, "question": question, "text": answer,
            });
            json!({
                "action": "http",
                "label": answer,
                "url": format!("{page}/api/acts"),
                "method": "POST",
                "headers": {
                    "Authorization": format!("Bearer {}", buttons.token.reveal()),
                    "Content-Type": "application/json",
                },
                "body": act.to_string(),
                "clear": true,
            })
        });
        each.collect()
    }
}

/// Returns the priority, from 1 to 5, and the symbol of a notice.
fn look(kind: NoticeKind) -> (u8, &'static str) {
    match kind {
        NoticeKind::Stop => (5, "octagonal_sign"),
        NoticeKind::Question => (4, "question"),
        NoticeKind::GoalLost => (4, "warning"),
        NoticeKind::GoalLate | NoticeKind::GoalLateSoon => (3, "hourglass"),
        NoticeKind::AgentGone => (3, "electric_plug"),
        NoticeKind::AgentBack | NoticeKind::Release => (3, "white_check_mark"),
    }
}

#[cfg(test)]
mod tests {
    use acl::AgentId;

    use super::*;

    fn topic(buttons: Option<AnswerButtons>) -> NtfyTopic {
        let address = ReceiverAddress::parse("https://ntfy.example/hall").expect("an address");
        NtfyTopic::new(address, ReceiverTrust::Machine, None, buttons).expect("a topic")
    }

    fn question(asked_at: Option<(AgentId, u64)>) -> NoticeDelivery {
        let notice = Notice::new(NoticeKind::Question, "q", 1).with_text("May I?");
        NoticeDelivery { id: "1".to_owned(), notices: vec![Notice { asked_at, ..notice }] }
    }

    fn form() -> NoticeForm {
        let page = Some("https://hall:8443".to_owned());
        NoticeForm { ecosystem: "lab".to_owned(), page, is_discreet: false }
    }

    fn buttons() -> AnswerButtons {
        let token = ChannelSecret::of("tk");
        AnswerButtons { answers: vec!["yes".to_owned(), "no".to_owned()], token }
    }

    #[test]
    fn a_question_has_buttons_that_answer_it() {
        let hall = AgentId::new("hall").expect("a name");
        let body = topic(Some(buttons())).body(&question(Some((hall, 3))), &form());
        assert_eq!((&body["topic"], &body["message"]), (&json!("hall"), &json!("May I?")));
        let action = &body["actions"][1];
        assert_eq!(action["url"], "https://hall:8443/api/acts");
        let act: Value =
            serde_json::from_str(action["body"].as_str().expect("text")).expect("JSON");
        let wanted = json!({ "act": "answer", "keyboard": "hall", "question": 3, "text": "no" });
        assert_eq!(act, wanted);
    }

    #[test]
    fn without_a_token_or_a_number_a_question_opens_the_page_and_no_token_leaves() {
        let hall = AgentId::new("hall").expect("a name");
        for (buttons, asked_at) in [(None, Some((hall, 3))), (Some(buttons()), None)] {
            let body = topic(buttons).body(&question(asked_at), &form());
            assert_eq!(body["actions"][0]["action"], "view");
            assert!(!body.to_string().contains("Bearer"), "{body}");
        }
        let body = topic(None).body(&question(None), &NoticeForm::default());
        assert_eq!((&body["click"], &body["actions"]), (&Value::Null, &Value::Null));
    }

    #[test]
    fn an_address_without_one_topic_is_refused() {
        for path in ["", "/", "/a/b", "/a?b", "/a%20b"] {
            let text = format!("https://ntfy.example{path}");
            let address = ReceiverAddress::parse(&text).expect("an address");
            assert!(NtfyTopic::new(address, ReceiverTrust::Machine, None, None).is_err(), "{path}");
        }
    }
}
