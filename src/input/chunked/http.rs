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

/// A URL with objects below it.
pub(super) struct Web {
    agent: Agent,
    /// Up to the query, without a slash at the end.
    base: String,
    /// With its question mark; empty where there is none.
    query: String,
    was_forbidden: AtomicBool,
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
        let mut request = self.agent.get(url);
        let range = match part {
            Part::Whole { .. } => None,
            Part::Range { at, bytes } => Some(format!(
                "bytes={at}-{}",
                at.saturating_add(bytes).saturating_sub(1)
            )),
            Part::Tail { bytes } => Some(format!("bytes=-{bytes}")),
        };
        if let Some(range) = &range {
            request = request.header("Range", range);
        }
        let response = request.call().map_err(|e| failed(subject, e))?;
        let status = response.status();
        let too_short = |found: &str| {
            let asked = range.as_deref().unwrap_or("all of it");
            Failure::Lasting(subject.malformed(asked, "so many bytes", found))
        };
        match status.as_u16() {
            200 if range.is_none() => {}
            206 if range.is_some() => {}
            200 => {
                return Err(Failure::Lasting(subject.unsupported(
                    "a shard on a server that sends only whole files",
                    "the server must answer range requests; download the folder instead",
                )));
            }
            404 | 410 => return Err(Failure::Missing),
            403 => return Err(Failure::Forbidden),
            416 => return Err(too_short("a file that is shorter")),
            408 | 429 | 500 | 502 | 503 | 504 => {
                return Err(Failure::Passing(status_error(status)));
            }
            _ => {
                return Err(Failure::Lasting(
                    subject.io("fetch it", status_error(status)),
                ));
            }
        }
        match part {
            Part::Whole { most_bytes } => {
                let bytes = body(response, most_bytes).map_err(|e| failed_body(subject, e))?;
                bytes.ok_or_else(|| Failure::Lasting(too_long(subject, most_bytes, "more")))
            }
            Part::Range { bytes: wanted, .. } | Part::Tail { bytes: wanted } => {
                let bytes = body(response, wanted).map_err(|e| failed_body(subject, e))?;
                match bytes {
                    Some(bytes) if bytes.len() as u64 == wanted => Ok(bytes),
                    Some(bytes) => Err(too_short(&format!("{} bytes", bytes.len()))),
                    None => Err(too_short("more")),
                }
            }
        }
    }
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
