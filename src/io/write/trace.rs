//! What threads did when, in Chrome's trace format ("Trace Event Format", JSON object form), which
//! chrome://tracing and ui.perfetto.dev open.
//!
//! One row for each thread; each span is a complete event (`"ph":"X"`), its name what the thread
//! did, its times in microseconds since the refinement began. They are written to the nanosecond,
//! both ends of a span rounded before they are subtracted: spans that follow each other do so in
//! the file too, and the events of a row stand in the order of time. Cost: about 70 bytes of file
//! per span.
//!
//! Thread safety: reads only.

use std::io::Write;
use std::path::Path;

use super::output::Output;
use super::records::{push_int, write_records};
use crate::error::shown;
use crate::monitor::CancelFlag;
use crate::refine::activity::{Doing, Span, ThreadReport};
use crate::{Error, Result};

/// Writes the timelines of `threads` to `path`, whatever its ending, until a flag is raised. An
/// existing file is replaced.
///
/// # Errors
/// [`Error::InvalidArgument`] when no thread has a timeline, because none was asked for;
/// [`Error::Io`]; [`Error::Cancelled`]. The temporary file is gone then, and an existing file as it
/// was.
pub fn write_timeline(
    threads: &[ThreadReport],
    path: &Path,
    cancel: Option<&CancelFlag>,
) -> Result<()> {
    if threads.iter().all(|thread| thread.timeline.is_empty()) {
        return Err(Error::InvalidArgument(format!(
            "{}: there is no timeline to write, the run was not asked to keep one",
            shown(path)
        )));
    }
    let mut output = Output::create(path)?.watching(cancel);
    output.fill(|out| {
        // Names first, so that every event below can begin with a comma.
        out.write_all(b"{\"displayTimeUnit\":\"ms\",\"traceEvents\":[\n")?;
        out.write_all(br#"{"ph":"M","pid":0,"name":"process_name","args":{"name":"refinement"}}"#)?;
        for row in 0..threads.len() {
            write!(
                out,
                ",\n{{\"ph\":\"M\",\"pid\":0,\"tid\":{row},\"name\":\"thread_name\",\
                 \"args\":{{\"name\":\"thread {row}\"}}}}"
            )?;
        }
        for (row, thread) in threads.iter().enumerate() {
            write_records(out, thread.timeline.len(), |i, bytes| {
                push_event(bytes, row, &thread.timeline[i]);
            })?;
        }
        out.write_all(b"\n]}\n")
    })?;
    Output::commit(vec![output])
}

/// The name of an event. None of them needs escapes.
fn name(doing: Doing) -> &'static str {
    match doing {
        Doing::Sampling => "sampling",
        Doing::Refining => "refining",
        Doing::RollingBack => "rolling back",
        Doing::Waiting => "waiting",
        Doing::Begging => "begging",
    }
}

/// Appends a span of the thread in `row`.
fn push_event(bytes: &mut Vec<u8>, row: usize, span: &Span) {
    let [start, end] = [span.start, span.end].map(nanoseconds);
    bytes.extend_from_slice(b",\n{\"ph\":\"X\",\"pid\":0,\"tid\":");
    push_int(bytes, row as i64);
    bytes.extend_from_slice(b",\"name\":\"");
    bytes.extend_from_slice(name(span.doing).as_bytes());
    bytes.extend_from_slice(b"\",\"ts\":");
    push_microseconds(bytes, start);
    bytes.extend_from_slice(b",\"dur\":");
    push_microseconds(bytes, (end - start).max(0));
    bytes.push(b'}');
}

fn nanoseconds(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}

/// Appends a time of at least 0 in microseconds, with three decimals.
fn push_microseconds(bytes: &mut Vec<u8>, nanoseconds: i64) {
    push_int(bytes, nanoseconds / 1000);
    let rest = nanoseconds % 1000;
    bytes.extend([b'.', digit(rest / 100), digit(rest / 10 % 10), digit(rest % 10)]);
}

fn digit(value: i64) -> u8 {
    b'0' + value as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_three_decimals() {
        let mut bytes = Vec::new();
        push_event(
            &mut bytes,
            3,
            &Span { doing: Doing::RollingBack, start: 1.000_000_042, end: 1.000_123 },
        );
        let expected = ",\n{\"ph\":\"X\",\"pid\":0,\"tid\":3,\"name\":\"rolling \
         back\",\"ts\":1000000.042,\"dur\":122.958}";
        assert_eq!(String::from_utf8(bytes).unwrap(), expected);
    }

    #[test]
    fn without_a_timeline_nothing_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("timeline.json");
        let error = write_timeline(&[ThreadReport::default()], &path, None).unwrap_err();
        assert!(
            matches!(error, Error::InvalidArgument(_))
                && error.to_string().contains("timeline.json"),
            "{error}"
        );
        let flag = CancelFlag::default();
        flag.cancel();
        let timeline = vec![Span { doing: Doing::Waiting, start: 0.0, end: 1.0 }];
        let thread = ThreadReport { timeline, ..ThreadReport::default() };
        assert!(matches!(write_timeline(&[thread], &path, Some(&flag)), Err(Error::Cancelled)));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
