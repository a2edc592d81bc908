//! Limits of time: `--time-limit` and `--deadline`. Work that is not finished by then ends, and what is finished is
//! kept.

use super::code::{Code, TIME_IS_UP};
use super::{Talk, heading, stop};
use jiff::civil::{DateTime, Time};
use jiff::{SignedDuration, Timestamp, ToSpan, ZonedDateTime};
use raybrook::Result;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::time::{Duration, Instant};

#[derive(clap::Args)]
pub struct LimitArgs {
    /// Stop after so long, such as 90s, 15m or 1h30m, and keep what is finished: the same command goes on.
    ///
    /// Counted from the program's start. A picture is rendered coarsely first, so that there is one when the time is
    /// up: with the pixels of all blocks that are finished. The exit code is then 124.
    #[arg(
        long,
        value_name = "DURATION",
        value_parser = parse_duration,
        hide_short_help = true,
        help_heading = heading::OUTPUT,
    )]
    time_limit: Option<Duration>,
    /// The same at a time of day, such as 18:30, or of a date, such as 2026-11-27T08:00 or 2026-11-27T08:00+01:00.
    ///
    /// Without an offset from UTC it is the time of this machine's place.
    #[arg(
        long,
        value_name = "TIME",
        value_parser = parse_deadline,
        conflicts_with = "time_limit",
        hide_short_help = true,
        help_heading = heading::OUTPUT,
    )]
    deadline: Option<Deadline>,
}

/// A time of the clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Deadline(Timestamp);

fn parse_duration(text: &str) -> std::result::Result<Duration, String> {
    let duration: Option<SignedDuration> = text.trim().parse().ok();
    let duration = duration.and_then(|duration| Duration::try_from(duration).ok()).filter(|d| !d.is_zero());
    duration.ok_or_else(|| "expected a duration above 0, such as 90s, 15m or 1h30m".to_owned())
}

fn parse_deadline(text: &str) -> std::result::Result<Deadline, String> {
    deadline_of(text.trim(), &ZonedDateTime::now())
}

/// The time that `text` means `now`.
fn deadline_of(text: &str, now: &ZonedDateTime) -> std::result::Result<Deadline, String> {
    let wrong = || "expected a time, such as 18:30, 2026-11-27T08:00 or 2026-11-27T08:00+01:00".to_owned();
    let of_place = |date: DateTime| date.to_zoned_datetime(now.time_zone().clone()).ok().map(|zoned| zoned.timestamp());
    let time = match (text.parse::<Timestamp>(), text.parse::<DateTime>(), text.parse::<Time>()) {
        (Ok(time), ..) => Some(time),
        (_, Ok(date), _) => of_place(date),
        (.., Ok(time)) => {
            // Today, or where that is over, tomorrow.
            let today = of_place(now.date().to_datetime(time)).filter(|time| *time > now.timestamp());
            today.or_else(|| of_place(now.date().checked_add(1.day()).ok()?.to_datetime(time)))
        }
        _ => None,
    };
    let time = time.ok_or_else(wrong)?;
    if time <= now.timestamp() { Err("this time is over".to_owned()) } else { Ok(Deadline(time)) }
}

impl LimitArgs {
    /// The limit of a run of the program that began at `start`.
    pub fn begin(&self, start: Instant) -> Limit {
        let until = |Deadline(time): Deadline| {
            let left = time.duration_since(Timestamp::now());
            // What is farther away than any clock goes is no limit.
            Instant::now().checked_add(Duration::try_from(left).unwrap_or_default())
        };
        let end = match (self.time_limit, self.deadline) {
            (Some(limit), _) => start.checked_add(limit),
            (None, deadline) => deadline.and_then(until),
        };
        Limit { end, option: if self.deadline.is_some() { "--deadline" } else { "--time-limit" } }
    }
}

/// Thrown through work when its time is up.
struct TimeIsUp;

/// When work is to end, if there is a limit.
#[derive(Debug, Clone, Copy)]
pub struct Limit {
    end: Option<Instant>,
    option: &'static str,
}

impl Limit {
    /// Whether there is one.
    pub fn is_set(self) -> bool {
        self.end.is_some()
    }

    /// The option that sets it.
    pub fn option(self) -> &'static str {
        self.option
    }

    /// Whether the time is up.
    pub fn is_over(self) -> bool {
        self.end.is_some_and(|end| Instant::now() >= end)
    }

    /// Ends the work of [`Limit::within`] where the time is up. For functions that are told of progress.
    pub fn check(self) {
        if self.is_over() {
            resume_unwind(Box::new(TimeIsUp));
        }
    }

    /// Does `work`; `None` when its time was up before it ended.
    ///
    /// # Errors
    /// Those of `work`.
    pub fn within<T>(self, work: impl FnOnce() -> Result<T>) -> Result<Option<T>> {
        match catch_unwind(AssertUnwindSafe(work)) {
            Ok(result) => result.map(Some),
            Err(panic) if panic.is::<TimeIsUp>() => Ok(None),
            Err(panic) => resume_unwind(panic),
        }
    }

    /// Says that the time is up and what is kept, and gives the exit code.
    pub fn end(self, talk: Talk) -> Code {
        stop::work_now();
        if !talk.quiet {
            tell!("raybrook: stopped by {}", self.option);
        }
        TIME_IS_UP
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use jiff::tz::TimeZone;

    #[test]
    fn durations_are_typed_with_units() {
        let seconds = |text| parse_duration(text).map(|duration| duration.as_secs_f64());
        for (text, expected) in [("90s", 90.0), ("15m", 900.0), ("2h", 7200.0), ("1h30m", 5400.0), ("250ms", 0.25)] {
            assert_eq!(seconds(text), Ok(expected), "{text}");
        }
        for wrong in ["", "90", "0s", "-5m", "soon", "1e400h"] {
            assert!(seconds(wrong).unwrap_err().contains("such as 90s"), "{wrong}");
        }
    }

    #[test]
    fn deadlines_are_times_of_day_or_of_a_date() {
        let offset = TimeZone::fixed(jiff::tz::offset(2));
        let now = "2026-11-26T16:00:00Z".parse::<Timestamp>().unwrap().to_zoned_datetime(offset); // 18:00 there
        let utc = |text| deadline_of(text, &now).map(|Deadline(time)| time.to_string());
        for (text, expected) in [
            ("18:30", "2026-11-26T16:30:00Z"),
            ("17:59", "2026-11-27T15:59:00Z"),
            ("2026-11-27T08:00", "2026-11-27T06:00:00Z"),
            ("2026-11-27 08:00:30", "2026-11-27T06:00:30Z"),
            ("2026-11-27T08:00+01:00", "2026-11-27T07:00:00Z"),
            ("2026-11-27T08:00:00Z", "2026-11-27T08:00:00Z"),
        ] {
            assert_eq!(utc(text).as_deref(), Ok(expected), "{text}");
        }
        assert!(utc("2026-11-26T17:00").unwrap_err().contains("is over"));
        for wrong in ["", "noon", "25:00", "2026-13-01T00:00"] {
            assert!(utc(wrong).unwrap_err().contains("such as 18:30"), "{wrong}");
        }
    }

    #[test]
    fn work_ends_when_its_time_is_up() {
        let args = |time_limit| LimitArgs { time_limit, deadline: None };
        let none = args(None).begin(Instant::now());
        none.check();
        assert!(!none.is_set() && !none.is_over());
        let over = args(Some(Duration::from_nanos(1))).begin(Instant::now());
        std::thread::sleep(Duration::from_millis(1));
        let ended = over.within(|| {
            over.check();
            Ok(())
        });
        assert!(matches!(ended, Ok(None)));
        assert!(matches!(over.within(|| Ok(3)), Ok(Some(3))));
    }
}
