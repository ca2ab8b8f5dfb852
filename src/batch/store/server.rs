//! What servers and connections say, put into words: what it was, and what can be done about it.

use super::error::credentials;
use super::{Kind, StoreError};
use object_store::Error;
use object_store::client::{HttpError, HttpErrorKind};
use std::error::Error as _;

/// Whose words a server speaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Server {
    /// S3, and all that speak as it does.
    Amazon,
    /// Google Cloud Storage.
    Google,
    /// Azure Blob Storage.
    Azure,
}

impl Server {
    pub(super) fn of_scheme(scheme: &str) -> Server {
        match scheme {
            "s3" => Server::Amazon,
            "gs" => Server::Google,
            _ => Server::Azure,
        }
    }

    fn scheme(self) -> &'static str {
        match self {
            Server::Amazon => "s3",
            Server::Google => "gs",
            Server::Azure => "az",
        }
    }

    /// What names of environment variables begin with.
    fn variables(self) -> &'static str {
        match self {
            Server::Amazon => "AWS_",
            Server::Google => "GOOGLE_",
            Server::Azure => "AZURE_",
        }
    }
}

/// An answer, as far as it can be read from the text of an error: `object_store` keeps it to itself.
#[derive(Debug, Default, PartialEq, Eq)]
struct Answer {
    status: Option<u16>,
    /// The server's own word for it, such as `NoSuchBucket`.
    code: Option<String>,
    message: Option<String>,
}

fn answer(text: &str) -> Answer {
    let after = |word: &str| text.split_once(word).map(|(_, rest)| rest);
    let between = |start: &str, end: &str| {
        let (found, _) = after(start)?.split_once(end)?;
        Some(found.trim().lines().next()?.to_owned()).filter(|found| !found.is_empty())
    };
    Answer {
        status: after("status code: ").and_then(|rest| rest.get(..3)?.parse().ok()),
        code: between("<Code>", "</Code>").or_else(|| between("\"error\":\"", "\"")),
        message: between("<Message>", "</Message>")
            .or_else(|| between("\"message\": \"", "\""))
            .or_else(|| between("\"message\":\"", "\"")),
    }
}

/// True if something is not there because the bucket is not there.
pub(super) fn is_without_bucket(error: &Error) -> bool {
    let text = error.to_string();
    ["NoSuchBucket", "ContainerNotFound", "specified bucket does not exist"].iter().any(|word| text.contains(word))
}

/// What was wrong when `place` was to be `done`: read, written, ...
pub(super) fn say(place: &str, server: Server, done: &str, error: &Error) -> StoreError {
    let text = error.to_string();
    let answer = answer(&text);
    let transport = transport(error);
    let kind = kind(error, &text, &answer, transport.as_ref().map(|(kind, _)| *kind));
    let found = match (&answer, transport) {
        (Answer { status: Some(status), code, message }, _) => {
            let words: Vec<&str> = [code.as_deref(), message.as_deref()].into_iter().flatten().collect();
            format!("the server says {status} {}", words.join(": ")).trim_end().to_owned()
        }
        (_, Some((_, innermost))) => innermost,
        _ => innermost(error),
    };
    let variables = server.variables();
    let way_out = match kind {
        _ if is_without_bucket(error) => "; is the name of the bucket right? It has to be there already".to_owned(),
        Kind::Denied => format!("; {}", credentials(server.scheme())),
        Kind::Again => "; it was tried several times, run the same command again later".to_owned(),
        Kind::Full => "; make room, and run the same command again".to_owned(),
        Kind::NotFound => "; is the name right?".to_owned(),
        _ if is_plain_http(&text) => format!("; for a server without encryption, set {variables}ALLOW_HTTP=true"),
        _ if text.contains("certificate") || text.contains("UnknownIssuer") => {
            "; the system has to trust who signed the server's certificate (on Debian: apt-get install ca-certificates)".to_owned()
        }
        _ if answer.status == Some(301) || text.contains("incorrectly configured region") => {
            "; is the region right? Set AWS_REGION".to_owned()
        }
        _ => String::new(),
    };
    StoreError { place: place.to_owned(), kind, problem: format!("cannot be {done}: {found}{way_out}") }
}

fn kind(error: &Error, text: &str, answer: &Answer, transport: Option<HttpErrorKind>) -> Kind {
    match answer.code.as_deref() {
        Some("RequestTimeout" | "SlowDown" | "OperationAborted" | "ConditionalRequestConflict") => return Kind::Again,
        Some("ExpiredToken" | "InvalidToken" | "InvalidAccessKeyId" | "InvalidAuthenticationInfo") => return Kind::Denied,
        Some("QuotaExceeded" | "InsufficientStorage" | "XMinioStorageFull" | "XMinioAdminBucketQuotaExceeded") => return Kind::Full,
        _ => {}
    }
    match (error, answer.status) {
        (Error::NotFound { .. }, _) | (_, Some(404)) => Kind::NotFound,
        (Error::PermissionDenied { .. } | Error::Unauthenticated { .. }, _) | (_, Some(401 | 403 | 407)) => Kind::Denied,
        (Error::NotSupported { .. } | Error::NotImplemented { .. } | Error::InvalidPath { .. }, _) | (_, Some(501)) => Kind::Unsupported,
        (_, Some(507)) => Kind::Full,
        (Error::AlreadyExists { .. } | Error::Precondition { .. }, _) | (_, Some(408 | 409 | 412 | 429 | 500..)) => Kind::Again,
        // what gives credentials to machines that have a role cannot be reached, or settings do not go together
        _ if ["169.254.", "metadata.google", "oauth", "redential", "AccessKey", "SecretAccess", "Account"]
            .iter()
            .any(|w| text.contains(w)) =>
        {
            Kind::Denied
        }
        _ if text.contains("certificate") || text.contains("UnknownIssuer") || is_plain_http(text) => Kind::Unsupported,
        _ if transport.is_some() => Kind::Again,
        _ => Kind::Other,
    }
}

fn is_plain_http(text: &str) -> bool {
    text.contains("URL scheme is not allowed")
}

/// What kind of connection trouble it was, and what the innermost cause says.
fn transport(error: &Error) -> Option<(HttpErrorKind, String)> {
    let mut cause = error.source();
    while let Some(at) = cause {
        if let Some(found) = at.downcast_ref::<HttpError>() {
            return Some((found.kind(), innermost(at)));
        }
        cause = at.source();
    }
    None
}

fn innermost(error: &(dyn std::error::Error + 'static)) -> String {
    let mut at = error;
    while let Some(cause) = at.source() {
        at = cause;
    }
    at.to_string()
}
