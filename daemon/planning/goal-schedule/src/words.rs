//! Times as people write them, on the command line and in the ecosystem file.

use acl::content::{GoalTimes, Keep};
use jiff::Timestamp;
use jiff::civil::{DateTime, Time};
use jiff::tz::TimeZone;

use crate::error::ScheduleError;
use crate::mark;
use crate::rule::RecurrenceRule;
use crate::schedule::Schedule;

/// The options of a goal that concern its times, as a person wrote them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TimeOptions {
    /// When the goal is asked for: `08:00`, `2026-12-01T08:00`.
    pub at: Option<String>,
    /// When the goal should be reached: a time, or a duration from when it is asked for.
    pub by: Option<String>,
    /// How often the goal is asked for: `day 08:00`, `15min`, a rule of RFC 5545.
    pub every: Option<String>,
    /// The days of the week: `workdays`, `weekend`, `mon,fri`.
    pub on: Option<String>,
    /// The hours of the day: `08:00-18:00`.
    pub between: Option<String>,
    /// When everything ends: a time or a date.
    pub until: Option<String>,
    /// How long the goal is pursued each time: `2h`.
    pub lasts: Option<String>,
}

/// Who has written times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Author {
    /// A person who asks now: `08:00` is the next time at which clocks show that.
    Person,
    /// The ecosystem file, which is read again and again: a single time needs its date.
    File,
}

/// Who asks for a goal, and when.
#[derive(Clone, Debug)]
pub struct Asking {
    /// The author of the times.
    pub author: Author,
    /// Whether the goal is reached once or kept.
    pub keep: Keep,
    /// The time zone of the times.
    pub zone: TimeZone,
    /// The present time.
    pub now: Timestamp,
}

const DAYS: [(&str, &str); 7] = [
    ("monday", "MO"),
    ("tuesday", "TU"),
    ("wednesday", "WE"),
    ("thursday", "TH"),
    ("friday", "FR"),
    ("saturday", "SA"),
    ("sunday", "SU"),
];

const EVERY_HELP: &str = "write \"day 08:00\", \"mon,fri 08:00\", \"month 1 08:00\", \"month last \
                          18:00\", \"year 12-24 18:00\", \"hour\", \"15min\", or a rule of RFC \
                          5545: \"RRULE:FREQ=DAILY;BYHOUR=8;BYMINUTE=0\"";

// === impl TimeOptions ===

impl TimeOptions {
    /// Whether no option is given.
    pub fn is_empty(&self) -> bool {
        *self == TimeOptions::default()
    }

    /// Returns the given options in the order in which people say them, each with its name.
    fn given(&self) -> impl Iterator<Item = (&'static str, &str)> {
        let all = [
            ("at", &self.at),
            ("every", &self.every),
            ("on", &self.on),
            ("between", &self.between),
            ("by", &self.by),
            ("for", &self.lasts),
            ("until", &self.until),
        ];
        all.into_iter().filter_map(|(name, text)| Some((name, text.as_deref()?.trim())))
    }

    fn has(&self, name: &str) -> bool {
        self.given().any(|(given, _)| given == name)
    }
}

/// Returns the options as one text for a person: `every day 08:00, on workdays, for 2h`.
pub fn spoken(options: &TimeOptions) -> String {
    let all: Vec<_> = options.given().map(|(name, text)| format!("{name} {text}")).collect();
    all.join(", ")
}

/// Reads the times that a person wrote.
///
/// # Errors
///
/// Returns the first mistake: a time that cannot be read, options that contradict, a time that is
/// past, or a recurrence that never comes.
pub fn read_options(options: &TimeOptions, asking: &Asking) -> Result<GoalTimes, ScheduleError> {
    check_combination(options, asking.keep)?;
    let today = mark::whole_seconds(asking.zone.to_datetime(asking.now));
    let mut times = GoalTimes {
        time_zone: asking.zone.iana_name().map(str::to_owned),
        ends: options.lasts.clone(),
        by: options.by.clone(),
        words: spoken(options),
        ..GoalTimes::default()
    };
    if let Some(lasts) = &options.lasts {
        mark::duration(lasts).map_err(|message| ScheduleError::new("for", message))?;
    }
    if let Some(until) = &options.until {
        times.until = Some(moment("until", until, asking, today)?);
    }
    if let Some(at) = &options.at {
        times.start = Some(moment("at", at, asking, today)?);
    }
    match (&options.every, &options.between) {
        (Some(every), between) => {
            times.rule = Some(with_days(rule(every)?, options.on.as_deref())?);
            times.start = Some(mark::next_minute(today).to_string());
            times.hours = between.clone();
        }
        (None, Some(between)) => window(between, options.on.as_deref(), today, &mut times)?,
        (None, None) => {}
    }
    check_result(&times, options, asking)?;
    Ok(times)
}

/// Checks that the options can stand together.
fn check_combination(options: &TimeOptions, keep: Keep) -> Result<(), ScheduleError> {
    let no = |option, message: &str| Err(ScheduleError::new(option, message));
    let is_repeated = options.has("every") || options.has("between");
    if options.has("at") && is_repeated {
        return no("at", "`at` is for once, and `every` and `between` are for again and again");
    }
    if options.has("on") && !is_repeated {
        return no("on", "`on` needs `every` or `between`, such as every \"day 08:00\"");
    }
    if options.has("between") && !options.has("every") {
        if keep == Keep::Achieve {
            return no(
                "between",
                "`between` alone keeps a goal in these hours: keep it (--maintain, keep = \
                 \"maintain\"), or say with `every` when it is asked for",
            );
        }
        if options.has("for") {
            return no("for", "the hours of `between` say already how long the goal is kept");
        }
    }
    Ok(())
}

/// Checks that the times are sound, and that they come.
fn check_result(
    times: &GoalTimes,
    options: &TimeOptions,
    asking: &Asking,
) -> Result<(), ScheduleError> {
    let schedule = Schedule::read(times, asking.zone.clone())?;
    let main = if options.every.is_some() { "every" } else { "between" };
    if !schedule.ever_comes() {
        let message = format!("this never comes: no time is {}", times.words);
        return Err(ScheduleError::new(main, message));
    }
    if asking.author == Author::File {
        return Ok(());
    }
    let is_past = |time: &Option<String>| {
        let time = time.as_deref().and_then(mark::date_time);
        time.and_then(|time| mark::instant(time, &asking.zone)).is_some_and(|at| at <= asking.now)
    };
    let message = |what: &str| format!("`{what}` is past; it is {}", now_text(asking));
    if options.at.is_some() && is_past(&times.start) {
        return Err(ScheduleError::new("at", message(options.at.as_deref().unwrap_or_default())));
    }
    if is_past(&times.until) {
        let until = options.until.as_deref().unwrap_or_default();
        return Err(ScheduleError::new("until", message(until)));
    }
    let begins = if schedule.is_at_once() { Some(asking.now) } else { None };
    let first = begins.or_else(|| schedule.next_after(Timestamp::MIN));
    let Some(first) = first else {
        let message = format!("this never comes before its end: {}", times.words);
        return Err(ScheduleError::new("until", message));
    };
    if schedule.occurrence(first).by.is_some_and(|by| by <= first) {
        let by = options.by.as_deref().unwrap_or_default();
        return Err(ScheduleError::new("by", message(by)));
    }
    Ok(())
}

fn now_text(asking: &Asking) -> String {
    asking.zone.to_datetime(asking.now).strftime("%A %Y-%m-%d %H:%M").to_string()
}

/// Reads a single time of the option `name`, and returns it in the form of [`GoalTimes`].
fn moment(
    name: &'static str,
    text: &str,
    asking: &Asking,
    today: DateTime,
) -> Result<String, ScheduleError> {
    let text = text.trim();
    if let Some(time) = mark::date_time(text) {
        return Ok(time.to_string());
    }
    if let Some(date) = mark::date(text) {
        // The whole day counts.
        return match date.tomorrow() {
            Ok(next) if name == "until" => Ok(next.to_datetime(Time::midnight()).to_string()),
            _ => Err(ScheduleError::new(name, format!("at what time? write {text}T08:00"))),
        };
    }
    let Some(time) = mark::time_of_day(text) else {
        let message = format!("`{text}` is no time; write 08:00 or {}T08:00", today.date());
        return Err(ScheduleError::new(name, message));
    };
    if asking.author == Author::File {
        let message = format!(
            "the file is read again and again, so a single time needs its date: {}T{text}; for each \
             day write every = \"day {text}\"",
            today.date()
        );
        return Err(ScheduleError::new(name, message));
    }
    let date = match time > today.time() {
        true => today.date(),
        false => today.date().tomorrow().unwrap_or(today.date()),
    };
    Ok(date.to_datetime(time).to_string())
}

/// Fills in the times of a goal that is kept in these hours of the day.
fn window(
    between: &str,
    on: Option<&str>,
    today: DateTime,
    times: &mut GoalTimes,
) -> Result<(), ScheduleError> {
    let Some((from, to)) = mark::hours(between).filter(|(from, to)| from != to) else {
        let message = format!("`{between}` are no hours of the day; write 08:00-18:00");
        return Err(ScheduleError::new("between", message));
    };
    let rule = format!("FREQ=DAILY;{}", at_time(from));
    times.rule = Some(with_days(rule, on)?);
    let now = today.time();
    let day = match from < to {
        // The hours of this day are over.
        true if to <= now => today.date().tomorrow(),
        // The hours that contain midnight have begun yesterday.
        false if now < to => today.date().yesterday(),
        _ => Ok(today.date()),
    };
    times.start = Some(day.unwrap_or(today.date()).to_datetime(from).to_string());
    let minutes = format!("{:02}:{:02}:{:02}", to.hour(), to.minute(), to.second());
    times.ends = Some(minutes);
    Ok(())
}

/// Returns the parts of a rule for one time of the day.
fn at_time(time: Time) -> String {
    let second = match time.second() {
        0 => String::new(),
        second => format!(";BYSECOND={second}"),
    };
    format!("BYHOUR={};BYMINUTE={}{second}", time.hour(), time.minute())
}

/// Reads how often a goal is asked for, and returns the rule.
fn rule(every: &str) -> Result<String, ScheduleError> {
    let every = every.trim();
    let wrong = |message: String| ScheduleError::new("every", message);
    if every.contains('=') {
        RecurrenceRule::read(every).map_err(wrong)?;
        return Ok(every.to_owned());
    }
    let unknown = || wrong(format!("`{every}` is no recurrence; {EVERY_HELP}"));
    let words: Vec<_> = every.split_whitespace().collect();
    let time = |text: &str| {
        mark::time_of_day(text).map(at_time).ok_or_else(|| {
            wrong(format!("`{text}` in `{every}` is no time of the day; write 08:00"))
        })
    };
    match words.as_slice() {
        ["minute"] => Ok("FREQ=MINUTELY".to_owned()),
        ["hour"] => Ok("FREQ=HOURLY;BYMINUTE=0".to_owned()),
        [unit @ ("day" | "week" | "month" | "year")] => {
            let example = match *unit {
                "week" => "week mon 08:00",
                "month" => "month 1 08:00",
                "year" => "year 12-24 18:00",
                _ => "day 08:00",
            };
            Err(wrong(format!("`{unit}` needs its time, such as \"{example}\"")))
        }
        ["day", at] => Ok(format!("FREQ=DAILY;{}", time(at)?)),
        ["week", on, at] | [on, at] if days(on).is_some() => {
            let on = days(on).unwrap_or_default();
            Ok(format!("FREQ=WEEKLY;BYDAY={on};{}", time(at)?))
        }
        ["month", day, at] => {
            let day = if *day == "last" { "-1" } else { *day };
            let number = day.trim_end_matches('.').parse::<i8>().ok();
            let number = number.filter(|number| *number == -1 || (1..=31).contains(number));
            let number = number.ok_or_else(|| wrong(format!("`{day}` is no day of a month")))?;
            Ok(format!("FREQ=MONTHLY;BYMONTHDAY={number};{}", time(at)?))
        }
        ["year", date, at] => {
            let (month, day) = date.split_once('-').ok_or_else(unknown)?;
            let number = |text: &str| text.parse::<u8>().ok();
            let (month, day) = number(month).zip(number(day)).ok_or_else(unknown)?;
            if !(1..=12).contains(&month) || !(1..=31).contains(&day) {
                let meant = match (1..=12).contains(&day) && (1..=31).contains(&month) {
                    true => format!("{day:02}-{month:02}"),
                    false => "12-24".to_owned(),
                };
                let message = format!(
                    "`{date}` in `{every}` is no day: the month stands first, such as {meant}"
                );
                return Err(wrong(message));
            }
            Ok(format!("FREQ=YEARLY;BYMONTH={month};BYMONTHDAY={day};{}", time(at)?))
        }
        [at] if mark::time_of_day(at).is_some() => {
            let meant = format!("a time needs its days: write \"day {at}\" or \"mon,fri {at}\"");
            Err(wrong(format!("`{every}` is no recurrence; {meant}")))
        }
        [length] => interval(length).ok_or_else(unknown)?,
        _ => Err(unknown()),
    }
}

/// Returns the rule for a duration: with the full hour if it divides the day, otherwise counted from
/// the time of asking. Returns `None` if the text is no duration.
fn interval(length: &str) -> Option<Result<String, ScheduleError>> {
    let seconds = mark::duration(length).ok()?.as_secs();
    let wrong = |message: String| Some(Err(ScheduleError::new("every", message)));
    if seconds % 60 != 0 {
        return wrong(format!("`{length}` is no whole number of minutes"));
    }
    let minutes = seconds / 60;
    let list = |step: i64, end: i64| {
        let all: Vec<_> = (0..end / step).map(|n| (n * step).to_string()).collect();
        all.join(",")
    };
    let interval = |unit: &str, number: i64| match number {
        1..=1_000 => Some(Ok(format!("FREQ={unit};INTERVAL={number}"))),
        _ => Some(Err(ScheduleError::new("every", format!("`{length}` is too long")))),
    };
    match minutes {
        1 => Some(Ok("FREQ=MINUTELY".to_owned())),
        _ if 60 % minutes == 0 => Some(Ok(format!("FREQ=HOURLY;BYMINUTE={}", list(minutes, 60)))),
        _ if minutes % 60 == 0 && 24 % (minutes / 60) == 0 && minutes < 24 * 60 => {
            Some(Ok(format!("FREQ=DAILY;BYHOUR={};BYMINUTE=0", list(minutes / 60, 24))))
        }
        _ if minutes % (24 * 60) == 0 => interval("DAILY", minutes / (24 * 60)),
        _ if minutes % 60 == 0 => interval("HOURLY", minutes / 60),
        _ => interval("MINUTELY", minutes),
    }
}

/// Leaves out of a rule all days but these.
fn with_days(rule: String, on: Option<&str>) -> Result<String, ScheduleError> {
    let Some(on) = on else { return Ok(rule) };
    let wrong = |message: String| Err(ScheduleError::new("on", message));
    let Some(days) = days(on.trim()) else {
        let meant = match on.trim().to_lowercase().as_str() {
            "weekday" | "weekdays" | "working days" => "did you mean workdays?",
            "weekends" => "did you mean weekend?",
            _ => "write workdays, weekend, or mon,wed,fri",
        };
        return wrong(format!("`{on}` names no days; {meant}"));
    };
    match RecurrenceRule::read(&rule) {
        Ok(read) if read.takes_days() => Ok(format!("{rule};BYDAY={days}")),
        Ok(_) => wrong("`every` says the days already".to_owned()),
        Err(message) => Err(ScheduleError::new("every", message)),
    }
}

/// Reads days of the week, and returns them as a rule has them.
fn days(text: &str) -> Option<String> {
    let lower = text.to_lowercase();
    match lower.as_str() {
        "workdays" | "workday" => return Some("MO,TU,WE,TH,FR".to_owned()),
        "weekend" => return Some("SA,SU".to_owned()),
        _ => {}
    }
    let day = |text: &str| {
        let text = text.trim();
        let begins = |(name, _): &&(&str, &str)| text.len() >= 3 && name.starts_with(text);
        DAYS.iter().find(begins).map(|(_, rule)| *rule)
    };
    let all: Option<Vec<_>> = lower.split(',').map(day).collect();
    let mut all = all?;
    all.dedup();
    Some(all.join(","))
}
