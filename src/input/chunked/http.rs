//! [`Web`]: objects behind an http or https URL, fetched whole or in part, tried again when the network or the server falters.
//!
//! No fetch waits for ever: connecting, the answer and its body each have a time after which they count as failed.

use std::io::{self, Read};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use flate2::bufread::MultiGzDecoder;
use ureq::http::{Response, StatusCode};
use ureq::{Agent, Body};

use super::store::{Part, too_long};
use crate::input::problem::Subject;
use crate::volume::SourceError;

/// Until a connection must stand.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(15);

/// Until a request must be answered.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(60);

/// Until the body of an answer must be there: a large chunk on a slow line takes minutes.
const BODY_TIMEOUT: Duration = Duration::from_secs(600);

/// How long is waited before each further try.
const WAITS: &[Duration] = if cfg!(test) {
    &[Duration::from_millis(5), Duration::from_millis(10)]
} else {
    &[
        Duration::from_millis(300),
        Duration::from_secs(2),
        Duration::from_secs(8),
    ]
};

/// How a range header begins that counts from an object's end.
const FROM_END: &str = "bytes=-";

/// A URL with objects below it.
pub(super) struct Web {
    agent: Agent,
    /// Up to the query, without a slash at the end.
    base: String,
    /// With its question mark; empty where there is none.
    query: String,
    was_forbidden: AtomicBool,
    /// Whether the server knows no ranges that count from an object's end.
    counts_from_start: AtomicBool,
}

/// Why a fetch did not bring what was asked for.
enum Failure {
    /// There is no such object.
    Missing,
    /// The server does not give it out.
    Forbidden,
    /// It may come when asked again.
    Passing(io::Error),
    /// Nothing will change that.
    Lasting(SourceError),
}

impl Web {
    /// The place behind `url`; nothing is fetched yet.
    ///
    /// # Errors
    /// This build can't fetch URLs of that kind.
    pub(super) fn open(url: &str) -> Result<Self, SourceError> {
        let subject = Subject::new(Path::new(url));
        let scheme = url.split("://").next().unwrap_or_default();
        match scheme.to_ascii_lowercase().as_str() {
            "http" => {}
            "https" if cfg!(feature = "remote") => {}
            "https" => {
                return Err(subject.unsupported(
                    "a URL with encryption (https)",
                    "this binary was built without it: build with --features remote, or download the folder",
                ));
            }
            _ => {
                return Err(subject.unsupported(
                    format!("a URL of {scheme}://"),
                    "supported are http:// and https://; most stores have such an address, too",
                ));
            }
        }
        let url = url.split('#').next().unwrap_or_default();
        let (base, query) = url.split_at(url.find('?').unwrap_or(url.len()));
        let config = Agent::config_builder()
            .http_status_as_error(false)
            .timeout_connect(Some(CONNECT_TIMEOUT))
            .timeout_recv_response(Some(ANSWER_TIMEOUT))
            .timeout_recv_body(Some(BODY_TIMEOUT))
            .user_agent(concat!("brickscope/", env!("CARGO_PKG_VERSION")))
            .build();
        Ok(Self {
            agent: config.new_agent(),
            base: base.trim_end_matches('/').to_owned(),
            query: query.to_owned(),
            was_forbidden: AtomicBool::new(false),
            counts_from_start: AtomicBool::new(false),
        })
    }

    /// The URL of the object `key`.
    pub(super) fn url(&self, key: &str) -> String {
        let mut url = self.base.clone();
        if !key.is_empty() {
            url.push('/');
        }
        for &byte in key.as_bytes() {
            if byte.is_ascii_alphanumeric() || b"-._~/!$'()*+,;=:@".contains(&byte) {
                url.push(byte.into());
            } else {
                url.push_str(&format!("%{byte:02X}"));
            }
        }
        url + &self.query
    }

    /// Whether a probe was answered with "forbidden".
    pub(super) fn was_forbidden(&self) -> bool {
        self.was_forbidden.load(Ordering::Relaxed)
    }

    /// The object `key`, or `None` where there is none.
    ///
    /// # Errors
    /// The server does not answer, or not with that.
    pub(super) fn get(&self, key: &str, part: Part) -> Result<Option<Vec<u8>>, SourceError> {
        self.fetch(key, part, false)
    }

    /// As [`Self::get`] for an object that may well be missing: what is forbidden counts as missing, too.
    pub(super) fn probe(&self, key: &str, part: Part) -> Result<Option<Vec<u8>>, SourceError> {
        self.fetch(key, part, true)
    }

    fn fetch(&self, key: &str, part: Part, is_probe: bool) -> Result<Option<Vec<u8>>, SourceError> {
        let url = self.url(key);
        let subject = Subject::new(Path::new(&url));
        let mut waits = WAITS.iter();
        loop {
            match self.attempt(&subject, &url, part) {
                Ok(bytes) => return Ok(Some(bytes)),
                Err(Failure::Missing) => return Ok(None),
                Err(Failure::Forbidden) if is_probe => {
                    self.was_forbidden.store(true, Ordering::Relaxed);
                    return Ok(None);
                }
                Err(Failure::Forbidden) => {
                    let error = status_error(StatusCode::FORBIDDEN);
                    return Err(subject.io("fetch it", error));
                }
                Err(Failure::Lasting(error)) => return Err(error),
                Err(Failure::Passing(error)) => match waits.next() {
                    Some(wait) => std::thread::sleep(*wait),
                    None => {
                        let tries = WAITS.len() + 1;
                        return Err(subject.io(format!("fetch it (tried {tries} times)"), error));
                    }
                },
            }
        }
    }

    fn attempt(&self, subject: &Subject<'_>, url: &str, part: Part) -> Result<Vec<u8>, Failure> {
        let (range, most_bytes) = match part {
            Part::Whole { most_bytes } => (None, most_bytes),
            Part::Range { at, bytes } => (Some(range_of(at, bytes)), bytes),
            Part::Tail { bytes } => (Some(self.range_of_tail(subject, url, bytes)?), bytes),
        };
        let mut request = self.agent.get(url);
        if let Some(range) = &range {
            request = request.header("Range", range);
        }
        let response = request.call().map_err(|e| failed(subject, e))?;
        let status = response.status().as_u16();
        let from_end = range.as_ref().is_some_and(|r| r.starts_with(FROM_END));
        if from_end && matches!(status, 200 | 400 | 416 | 501) {
            // Not every server knows ranges that count from the end: from now on they count from the beginning.
            self.counts_from_start.store(true, Ordering::Relaxed);
            return self.attempt(subject, url, part);
        }
        let expected = if range.is_some() { 206 } else { 200 };
        if status == 200 && expected == 206 {
            return Err(Failure::Lasting(subject.unsupported(
                "a shard on a server that sends only whole files",
                "the server must answer range requests; download the folder instead",
            )));
        }
        check_status(subject, &response, expected)?;
        let bytes = body(response, most_bytes).map_err(|e| failed_body(subject, e))?;
        let Some(bytes) = bytes else {
            return Err(Failure::Lasting(too_long(subject, most_bytes, "more")));
        };
        match range {
            Some(range) if bytes.len() as u64 != most_bytes => {
                let found = format!("{} bytes", bytes.len());
                Err(Failure::Lasting(subject.malformed(
                    range,
                    format!("{most_bytes} bytes"),
                    found,
                )))
            }
            _ => Ok(bytes),
        }
    }

    /// The range header for the last `bytes` bytes of an object.
    fn range_of_tail(
        &self,
        subject: &Subject<'_>,
        url: &str,
        bytes: u64,
    ) -> Result<String, Failure> {
        if !self.counts_from_start.load(Ordering::Relaxed) {
            return Ok(format!("{FROM_END}{bytes}"));
        }
        let response = self.agent.head(url).call();
        let response = response.map_err(|e| failed(subject, e))?;
        check_status(subject, &response, 200)?;
        let len = response
            .headers()
            .get("content-length")
            .and_then(|v| v.to_str().ok()?.parse::<u64>().ok());
        match len.and_then(|len| len.checked_sub(bytes)) {
            Some(at) => Ok(range_of(at, bytes)),
            None => Err(Failure::Lasting(subject.malformed(
                "its length",
                format!("at least {bytes} bytes"),
                len.map_or("nothing that says it".to_owned(), |n| n.to_string()),
            ))),
        }
    }
}

/// The range header for `bytes` bytes from byte `at` on.
fn range_of(at: u64, bytes: u64) -> String {
    let last = at.saturating_add(bytes).saturating_sub(1);
    format!("bytes={at}-{last}")
}

fn check_status(
    subject: &Subject<'_>,
    response: &Response<Body>,
    expected: u16,
) -> Result<(), Failure> {
    let status = response.status();
    Err(match status.as_u16() {
        s if s == expected => return Ok(()),
        404 | 410 => Failure::Missing,
        403 => Failure::Forbidden,
        408 | 429 | 500 | 502 | 503 | 504 => Failure::Passing(status_error(status)),
        _ => Failure::Lasting(subject.io("fetch it", status_error(status))),
    })
}

/// The body of `response`; `None` when it is longer than `most_bytes`.
fn body(response: Response<Body>, most_bytes: u64) -> io::Result<Option<Vec<u8>>> {
    // Some servers pack what they send, asked or not.
    let is_packed = response
        .headers()
        .get("content-encoding")
        .is_some_and(|v| v.as_bytes().eq_ignore_ascii_case(b"gzip"));
    let most = most_bytes.saturating_add(1);
    let stream = response
        .into_body()
        .into_with_config()
        .limit(u64::MAX)
        .reader();
    let mut bytes = Vec::new();
    if is_packed {
        let buffered = io::BufReader::new(stream);
        MultiGzDecoder::new(buffered)
            .take(most)
            .read_to_end(&mut bytes)?;
    } else {
        stream.take(most).read_to_end(&mut bytes)?;
    }
    Ok((bytes.len() as u64 <= most_bytes).then_some(bytes))
}

fn status_error(status: StatusCode) -> io::Error {
    io::Error::other(format!("the server answers {status}"))
}

fn failed(subject: &Subject<'_>, error: ureq::Error) -> Failure {
    match error {
        // A certificate that is not trusted, an answer that is no HTTP: the next one would be the same.
        ureq::Error::Io(error) if error.kind() == io::ErrorKind::InvalidData => {
            Failure::Lasting(subject.io("fetch it", error))
        }
        ureq::Error::Io(error) => Failure::Passing(error),
        ureq::Error::Timeout(_) | ureq::Error::ConnectionFailed => {
            Failure::Passing(io::Error::other(error.to_string()))
        }
        other => Failure::Lasting(subject.io("fetch it", io::Error::other(other.to_string()))),
    }
}

fn failed_body(subject: &Subject<'_>, error: io::Error) -> Failure {
    match error.kind() {
        io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput => {
            Failure::Lasting(subject.malformed(
                "the body of the answer",
                "sound gzip data",
                error.to_string(),
            ))
        }
        _ => Failure::Passing(error),
    }
}

#[cfg(test)]
mod tests;
