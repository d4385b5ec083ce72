//! The `config` of the entry: the channels, and what belongs to all of them.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use agent::{Blueprint, BuildCheck, BuildError, EcosystemFolder, StateFolder};
use jiff::Timestamp;
use jiff::civil::{Date, DateTime};
use jiff::tz::TimeZone;
use serde::Deserialize;

use crate::address::{ReceiverAddress, host_and_port};
use crate::channel::{ChannelTarget, NotifierChannel};
use crate::channel_rules::ChannelRules;
use crate::channel_secret::ChannelSecret;
use crate::mail::{MailRelay, MailSecurity};
use crate::notice::NoticeEvent;
use crate::ntfy::{AnswerButtons, NtfyTopic};
use crate::quiet_hours::QuietHours;
use crate::sentences::NoticeForm;
use crate::trust::ReceiverTrust;
use crate::web_push::WebPush;
use crate::web_push::push_store::{KNOWN_SERVICES, PushStore};
use crate::webhook::Webhook;

/// Maximum number of channels of one notifier.
const CHANNELS_MAX: usize = 32;

/// Maximum number of receivers of one e-mail.
const MAIL_RECEIVERS_MAX: usize = 32;

/// Sendings per hour of a channel whose entry states none: one every two minutes.
const PER_HOUR: u32 = 30;

/// Greatest number of sendings per hour; the times of all are remembered.
const PER_HOUR_MAX: u32 = 1_000;

/// Limits of `gone-after`.
const GONE_AFTER_MIN: Duration = Duration::from_secs(1);
const GONE_AFTER_MAX: Duration = Duration::from_secs(7 * 24 * 3_600);

/// The `config` table of the agent's entry in the ecosystem file.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct NotifierConfig {
    /// Address of the page, for links.
    page: Option<String>,
    /// Time after which people are told that an agent is gone.
    #[serde(default = "gone_after_by_default")]
    gone_after: String,
    /// The channels.
    to: Vec<ChannelEntry>,
}

fn gone_after_by_default() -> String {
    "1min".to_owned()
}

/// Kind of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum ChannelKind {
    Webhook,
    Ntfy,
    Email,
    WebPush,
}

/// One element of `to`. Which keys it may have depends on its kind.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct ChannelEntry {
    kind: ChannelKind,
    events: Option<BTreeSet<NoticeEvent>>,
    quiet: Option<String>,
    #[serde(default)]
    quiet_stops: bool,
    until: Option<String>,
    per_hour: Option<u32>,
    include_text: Option<bool>,
    ca: Option<PathBuf>,
    url: Option<String>,
    secret_file: Option<PathBuf>,
    token_file: Option<PathBuf>,
    answers: Option<Vec<String>>,
    answer_token_file: Option<PathBuf>,
    relay: Option<String>,
    security: Option<MailSecurity>,
    user: Option<String>,
    password_file: Option<PathBuf>,
    from: Option<String>,
    receivers: Option<Vec<String>>,
    contact: Option<String>,
    services: Option<Vec<String>>,
}

/// All that the entry says.
pub(crate) struct NotifierSettings {
    pub(crate) gone_after: Duration,
    pub(crate) channels: Vec<NotifierChannel>,
}

/// The surroundings of an entry.
struct EntryPlace<'b> {
    blueprint: &'b Blueprint,
    page: Option<String>,
    /// Whether files are not read: the entry is only checked, perhaps on another machine.
    is_check: bool,
}

/// Reads the `config` of the entry.
pub(crate) fn settings(blueprint: &Blueprint) -> Result<NotifierSettings, BuildError> {
    let NotifierConfig { page, gone_after, to } = blueprint.config_as()?;
    let problem = |text: String| blueprint.problem(text);
    let parsed = humantime::parse_duration(&gone_after).ok();
    let parsed = parsed.filter(|time| (GONE_AFTER_MIN..=GONE_AFTER_MAX).contains(time));
    let gone_after = parsed.ok_or_else(|| {
        problem(format!(
            "`gone-after = \"{gone_after}\"`: write a time from 1s to 7days, such as \"1min\""
        ))
    })?;
    if to.is_empty() || to.len() > CHANNELS_MAX {
        return Err(problem(format!("`to` needs 1 to {CHANNELS_MAX} channels")));
    }
    let page = page.map(|page| page_origin(&page)).transpose().map_err(problem)?;
    let is_check = blueprint.host.resources.get::<BuildCheck>().is_some();
    let place = EntryPlace { blueprint, page, is_check };
    let channels = to.iter().enumerate().map(|(index, entry)| {
        let number = index + 1;
        let channel = place.channel(number, entry);
        channel.map_err(|why| {
            problem(format!("channel {number} of `to` ({}): {why}", entry.kind.as_str()))
        })
    });
    Ok(NotifierSettings { gone_after, channels: channels.collect::<Result<_, _>>()? })
}

/// Returns the address of the page without a path.
fn page_origin(page: &str) -> Result<String, String> {
    let wrong = |why: &str| {
        format!("`page = \"{page}\"`: {why}; write an address such as \"https://hall-pi:8443\"")
    };
    let address = ReceiverAddress::parse(page).map_err(wrong)?;
    match address.path.as_str() {
        "/" => Ok(address.origin()),
        _ => Err(wrong("it has a path, and the page is served at `/`")),
    }
}

// === impl ChannelKind ===

impl ChannelKind {
    fn as_str(self) -> &'static str {
        match self {
            ChannelKind::Webhook => "webhook",
            ChannelKind::Ntfy => "ntfy",
            ChannelKind::Email => "email",
            ChannelKind::WebPush => "web-push",
        }
    }

    /// Returns the keys that a channel of this kind may have besides those of all.
    fn keys(self) -> &'static [&'static str] {
        match self {
            ChannelKind::Webhook => &["url", "secret-file"],
            ChannelKind::Ntfy => &["url", "token-file", "answers", "answer-token-file"],
            ChannelKind::Email => {
                &["relay", "security", "user", "password-file", "from", "receivers"]
            }
            ChannelKind::WebPush => &["contact", "services"],
        }
    }
}

// === impl ChannelEntry ===

impl ChannelEntry {
    /// Returns the keys of single kinds that the entry has.
    fn special_keys(&self) -> impl Iterator<Item = &'static str> {
        let keys = [
            ("url", self.url.is_some()),
            ("secret-file", self.secret_file.is_some()),
            ("token-file", self.token_file.is_some()),
            ("answers", self.answers.is_some()),
            ("answer-token-file", self.answer_token_file.is_some()),
            ("relay", self.relay.is_some()),
            ("security", self.security.is_some()),
            ("user", self.user.is_some()),
            ("password-file", self.password_file.is_some()),
            ("from", self.from.is_some()),
            ("receivers", self.receivers.is_some()),
            ("contact", self.contact.is_some()),
            ("services", self.services.is_some()),
        ];
        keys.into_iter().filter(|(_, is_there)| *is_there).map(|(key, _)| key)
    }

    fn rules(&self) -> Result<ChannelRules, String> {
        let all = [
            NoticeEvent::Question,
            NoticeEvent::GoalLost,
            NoticeEvent::GoalLate,
            NoticeEvent::AgentGone,
            NoticeEvent::Stop,
        ];
        let events = self.events.clone().unwrap_or_else(|| all.into());
        if events.is_empty() {
            return Err("`events` is empty; leave it out for all, or name some of \"question\", \
                        \"goal-lost\", \"goal-late\", \"agent-gone\", \"stop\""
                .to_owned());
        }
        let per_hour = self.per_hour.unwrap_or(PER_HOUR);
        if !(1..=PER_HOUR_MAX).contains(&per_hour) {
            return Err(format!(
                "`per-hour = {per_hour}`: write a number from 1 to {PER_HOUR_MAX}"
            ));
        }
        let quiet = self.quiet.as_deref().map(QuietHours::parse).transpose()?;
        if self.quiet_stops && quiet.is_none() {
            return Err("`quiet-stops` needs `quiet`, such as \"22:00-07:00\"".to_owned());
        }
        let until = self.until.as_deref().map(end).transpose()?;
        Ok(ChannelRules { events, quiet, are_stops_quiet: self.quiet_stops, until, per_hour })
    }
}

/// Parses the end of a channel: the end of a day, or a time of a day, by the clock of the machine.
fn end(text: &str) -> Result<Timestamp, String> {
    let day = text.parse::<Date>().ok().filter(|_| text.len() == "2027-01-31".len());
    let time = match day {
        Some(day) => {
            day.tomorrow().ok().map(|next| next.to_datetime(jiff::civil::Time::midnight()))
        }
        None => text.parse::<DateTime>().ok(),
    };
    let end = time.and_then(|time| TimeZone::system().to_timestamp(time).ok());
    end.ok_or_else(|| {
        format!(
            "`until = \"{text}\"`: write a day, such as \"2027-01-31\", or a time, such as \
             \"2027-01-31T18:00\""
        )
    })
}

// === impl EntryPlace ===

impl EntryPlace<'_> {
    fn channel(&self, number: usize, entry: &ChannelEntry) -> Result<NotifierChannel, String> {
        let kind = entry.kind;
        if let Some(key) = entry.special_keys().find(|key| !kind.keys().contains(key)) {
            return Err(format!("`{key}` is no key of this kind; it may have {}", listed(kind)));
        }
        let trust = match &entry.ca {
            Some(file) => ReceiverTrust::File(self.path(file)),
            None => ReceiverTrust::Machine,
        };
        let target = match kind {
            ChannelKind::Webhook => self.webhook(entry, trust)?,
            ChannelKind::Ntfy => self.ntfy(entry, trust)?,
            ChannelKind::Email => self.mail(entry, trust)?,
            ChannelKind::WebPush => self.web_push(entry, trust)?,
        };
        let form = NoticeForm {
            // The agent writes the name of the ecosystem when it begins.
            ecosystem: String::new(),
            page: self.page.clone(),
            is_discreet: entry.include_text == Some(false),
        };
        let name = format!("{number} ({})", kind.as_str());
        Ok(NotifierChannel { name, rules: entry.rules()?, form, target })
    }

    /// A relative path begins at the folder of the ecosystem file.
    fn path(&self, path: &Path) -> PathBuf {
        let folder = self.blueprint.host.resources.get::<EcosystemFolder>();
        folder.map_or(path.to_owned(), |folder| folder.0.join(path))
    }

    fn secret(&self, file: &Path) -> Result<ChannelSecret, String> {
        match self.is_check {
            true => Ok(ChannelSecret::unread()),
            false => ChannelSecret::read(&self.path(file)),
        }
    }

    /// Returns the address in `url`, which is not repeated in an error: it may be a secret.
    fn address(&self, entry: &ChannelEntry) -> Result<ReceiverAddress, String> {
        let url = entry.url.as_deref().ok_or("`url` is missing, the address to send to")?;
        let address = ReceiverAddress::parse(url).map_err(|why| format!("`url`: {why}"))?;
        match entry.ca {
            Some(_) if !address.is_encrypted => {
                Err("`ca` is for https://, and `url` is http://".to_owned())
            }
            _ => Ok(address),
        }
    }

    fn webhook(&self, entry: &ChannelEntry, trust: ReceiverTrust) -> Result<ChannelTarget, String> {
        let address = self.address(entry)?;
        let file = entry.secret_file.as_deref().ok_or(
            "`secret-file` is missing: with its secret the receiver checks that a notice is from \
             here",
        )?;
        let webhook = Webhook::new(address, trust, &self.secret(file)?)?;
        Ok(ChannelTarget::Webhook(Arc::new(webhook)))
    }

    fn ntfy(&self, entry: &ChannelEntry, trust: ReceiverTrust) -> Result<ChannelTarget, String> {
        let address = self.address(entry)?;
        let token = entry.token_file.as_deref().map(|file| self.secret(file)).transpose()?;
        let buttons = match (&entry.answers, &entry.answer_token_file, &self.page) {
            (None, None, _) => None,
            (Some(answers), Some(file), Some(_)) => {
                let is_word = |answer: &String| !answer.trim().is_empty() && answer.len() <= 64;
                if answers.is_empty() || !answers.iter().all(is_word) {
                    return Err("`answers` needs 1 to 3 short texts".to_owned());
                }
                let token = self.secret(file)?;
                Some(AnswerButtons { answers: answers.clone(), token })
            }
            _ => {
                return Err("buttons need `answers`, `answer-token-file`, and the `page` of the \
                            notifier, which takes the answer"
                    .to_owned());
            }
        };
        let topic = NtfyTopic::new(address, trust, token, buttons);
        Ok(ChannelTarget::Ntfy(Arc::new(topic.map_err(|why| format!("`url`: {why}"))?)))
    }

    fn mail(&self, entry: &ChannelEntry, trust: ReceiverTrust) -> Result<ChannelTarget, String> {
        let relay = entry.relay.as_deref().ok_or("`relay` is missing, such as \"mail.example\"")?;
        let security = entry.security.unwrap_or(MailSecurity::Starttls);
        let relay = host_and_port(relay, security.port())
            .filter(|(host, _)| host.bytes().all(|byte| byte.is_ascii_graphic()))
            .ok_or(
                "`relay`: its host or port is wrong; write \"mail.example\" or \
                    \"mail.example:587\"",
            )?;
        let login = match (&entry.user, &entry.password_file) {
            (None, None) => None,
            (Some(user), Some(file)) => Some((user.clone(), self.secret(file)?)),
            _ => return Err("a login needs `user` and `password-file`".to_owned()),
        };
        let from = entry.from.as_deref().ok_or("`from` is missing, the sender's address")?;
        let receivers = entry.receivers.as_deref().unwrap_or_default();
        if receivers.is_empty() || receivers.len() > MAIL_RECEIVERS_MAX {
            return Err(format!("`receivers` needs 1 to {MAIL_RECEIVERS_MAX} addresses"));
        }
        let relay = MailRelay::new(relay, (security, trust), login, (from, receivers))?;
        Ok(ChannelTarget::Mail(Arc::new(relay)))
    }

    fn web_push(
        &self,
        entry: &ChannelEntry,
        trust: ReceiverTrust,
    ) -> Result<ChannelTarget, String> {
        let contact = entry.contact.clone().filter(|contact| {
            let (mail, page) = (contact.strip_prefix("mailto:"), contact.strip_prefix("https://"));
            mail.is_some_and(|mail| mail.contains('@')) || page.is_some_and(|page| !page.is_empty())
        });
        let contact = contact.ok_or(
            "`contact` must be the address at which push services reach you, such as \
             \"mailto:caretaker@example.org\"",
        )?;
        let services = match &entry.services {
            None => KNOWN_SERVICES.map(str::to_owned).to_vec(),
            Some(services) => {
                let origin = |service: &String| match service.strip_prefix("https://*.") {
                    Some(end) if !end.contains(['/', '*']) && !end.is_empty() => {
                        Ok(service.clone())
                    }
                    _ => ReceiverAddress::parse(service).map(|address| address.origin()),
                };
                let origins: Result<Vec<_>, _> = services.iter().map(origin).collect();
                origins.map_err(|why| format!("`services`: {why}"))?
            }
        };
        let folder = self.blueprint.host.resources.get::<StateFolder>();
        let folder = match (folder, self.is_check) {
            (Some(folder), _) => PushStore::folder_of(&folder.0, &self.blueprint.id),
            (None, true) => PathBuf::new(),
            (None, false) => return Err("subscriptions need a state folder".to_owned()),
        };
        let push = WebPush::new(folder, contact, services, trust);
        Ok(ChannelTarget::WebPush(Arc::new(push)))
    }
}

/// Returns the keys of a kind for a sentence.
fn listed(kind: ChannelKind) -> String {
    let keys: Vec<_> = kind.keys().iter().map(|key| format!("`{key}`")).collect();
    keys.join(", ")
}

#[cfg(test)]
mod tests;
