//! What servers and connections say, put into words: what it was, and what can be done about it.

use super::error::credentials;
use super::{Kind, StoreError};
use object_store::Error;
use object_store::client::HttpError;
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

/// What makes a certificate one that can be trusted.
const TRUST: &str =
    "the system has to trust who signed the server's certificate; on Debian: apt-get install ca-certificates, elsewhere: SSL_CERT_FILE";

/// Why a place cannot be used with the settings that there are.
pub(super) fn say_of_settings(place: &str, server: Server, error: &Error) -> StoreError {
    let (kind, way_out) = match all_causes(error) {
        text if is_untrusted(&text) => (Kind::Unsupported, TRUST),
        _ => (Kind::Denied, credentials(server.scheme())),
    };
    StoreError { place: place.to_owned(), kind, problem: format!("cannot be used: {}; {way_out}", innermost(error)) }
}

/// What was wrong when `place` was to be `done`: read, written, ...
pub(super) fn say(place: &str, server: Server, done: &str, error: &Error) -> StoreError {
    let text = all_causes(error);
    let answer = answer(&text);
    let transport = transport(error);
    let kind = kind(error, &text, &answer, transport.is_some());
    let found = match (&answer, transport) {
        _ if is_of_credentials(&text) => {
            let status = answer.status.map(|status| format!("it says {status}"));
            let from = origin(&text).unwrap_or_else(|| "the machine".to_owned());
            format!("no credentials are set, and {from} gives none: {}", status.unwrap_or_else(|| innermost(error)))
        }
        (Answer { status: Some(status), code, message }, _) => {
            let words: Vec<&str> = [code.as_deref(), message.as_deref()].into_iter().flatten().collect();
            format!("the server says {status} {}", words.join(": ")).trim_end().to_owned()
        }
        (_, Some(innermost)) => origin(&text).map_or(innermost.clone(), |server| format!("{server}: {innermost}")),
        _ if matches!(error, Error::InvalidPath { .. }) => format!("it holds an object whose name cannot be used here: {error}"),
        _ => innermost(error),
    };
    let variables = server.variables();
    let way_out = match kind {
        _ if is_without_bucket(error) => "; is the name of the bucket right? It has to be there already".to_owned(),
        Kind::Denied => format!("; {}", credentials(server.scheme())),
        Kind::Again => "; it may work later: run the same command again".to_owned(),
        Kind::Full => "; make room, and run the same command again".to_owned(),
        Kind::NotFound => "; is the name right?".to_owned(),
        _ if matches!(error, Error::InvalidPath { .. }) => {
            "; rename it (its parts must not be empty, . or .., nor have control characters), or name a prefix without it".to_owned()
        }
        _ if is_plain_http(&text) => format!("; for a server without encryption, set {variables}ALLOW_HTTP=true"),
        _ if is_untrusted(&text) => format!("; {TRUST}"),
        _ if is_elsewhere(&text, &answer) => "; is the region right? AWS_REGION names it".to_owned(),
        _ => String::new(),
    };
    StoreError { place: place.to_owned(), kind, problem: format!("cannot be {done}: {found}{way_out}") }
}

fn kind(error: &Error, text: &str, answer: &Answer, no_answer: bool) -> Kind {
    match answer.code.as_deref() {
        Some("RequestTimeout" | "SlowDown" | "OperationAborted" | "ConditionalRequestConflict") => return Kind::Again,
        Some("ExpiredToken" | "InvalidToken" | "InvalidAccessKeyId" | "InvalidAuthenticationInfo") => return Kind::Denied,
        Some("QuotaExceeded" | "InsufficientStorage" | "XMinioStorageFull" | "XMinioAdminBucketQuotaExceeded") => return Kind::Full,
        _ => {}
    }
    match (error, answer.status) {
        _ if is_of_credentials(text) => Kind::Denied,
        (Error::NotFound { .. }, _) | (_, Some(404)) => Kind::NotFound,
        (Error::PermissionDenied { .. } | Error::Unauthenticated { .. }, _) | (_, Some(401 | 403 | 407)) => Kind::Denied,
        (Error::NotSupported { .. } | Error::NotImplemented { .. } | Error::InvalidPath { .. }, _) | (_, Some(501)) => Kind::Unsupported,
        (_, Some(507)) => Kind::Full,
        (Error::AlreadyExists { .. } | Error::Precondition { .. }, _) | (_, Some(408 | 409 | 412 | 429 | 500..)) => Kind::Again,
        _ if is_untrusted(text) || is_plain_http(text) || is_elsewhere(text, answer) => Kind::Unsupported,
        _ if no_answer => Kind::Again,
        _ => Kind::Other,
    }
}

/// True if what gives credentials to machines that have a role was asked.
fn is_of_credentials(text: &str) -> bool {
    ["//169.254.", "//metadata.google", "//metadata/", "oauth2", "login.microsoftonline"].iter().any(|word| text.contains(word))
}

fn is_plain_http(text: &str) -> bool {
    text.contains("URL scheme is not allowed")
}

fn is_untrusted(text: &str) -> bool {
    ["invalid peer certificate", "No CA certificates", "no CA certificates", "UnknownIssuer"].iter().any(|word| text.contains(word))
}

fn is_elsewhere(text: &str, answer: &Answer) -> bool {
    matches!(answer.status, Some(301 | 307)) || text.contains("incorrectly configured region")
}

/// What the innermost cause says, if there was no answer.
fn transport(error: &Error) -> Option<String> {
    let mut cause = error.source();
    while let Some(at) = cause {
        if at.is::<HttpError>() {
            return Some(innermost(at));
        }
        cause = at.source();
    }
    None
}

/// The address of a server in a text, without user, path and query, which may be secret.
fn origin(text: &str) -> Option<String> {
    let start = text.find("https://").or_else(|| text.find("http://"))?;
    let (scheme, rest) = text[start..].split_once("://")?;
    let host = rest.split(['/', '?', ' ', ')', '"']).next()?;
    Some(format!("{scheme}://{}", host.rsplit('@').next()?))
}

fn innermost(error: &(dyn std::error::Error + 'static)) -> String {
    let mut at = error;
    while let Some(cause) = at.source() {
        at = cause;
    }
    at.to_string()
}

fn all_causes(error: &Error) -> String {
    let (mut text, mut cause) = (error.to_string(), error.source());
    while let Some(at) = cause {
        text = format!("{text}: {at}");
        cause = at.source();
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn generic(text: &str) -> Error {
        Error::Generic { store: "S3", source: text.to_owned().into() }
    }

    /// Texts as `object_store` makes them: if another version makes others, this shows it.
    #[test]
    fn what_servers_say_leads_to_what_can_be_done() {
        for (text, kind, problem) in [
            (
                "Error performing GET http://127.0.0.1:1/b/x in 1s, after 6 retries, max_retries: 6, retry_timeout: 90s  - Server returned \
                 non-2xx status code: 503 Service Unavailable: <Error><Code>SlowDown</Code><Message>Reduce your rate</Message></Error>",
                Kind::Again,
                "cannot be read: the server says 503 SlowDown: Reduce your rate; it may work later: run the same command again",
            ),
            (
                "Server returned non-2xx status code: 507 Insufficient Storage: ",
                Kind::Full,
                "cannot be read: the server says 507; make room, and run the same command again",
            ),
            (
                "Server returned non-2xx status code: 400 Bad Request: <Code>XMinioStorageFull</Code>",
                Kind::Full,
                "cannot be read: the server says 400 XMinioStorageFull; make room, and run the same command again",
            ),
            (
                "Server returned non-2xx status code: 404 Not Found: <Code>NoSuchBucket</Code>",
                Kind::NotFound,
                "cannot be read: the server says 404 NoSuchBucket; is the name of the bucket right? It has to be there already",
            ),
            (
                "Received redirect without LOCATION, this normally indicates an incorrectly configured region",
                Kind::Unsupported,
                "cannot be read: Received redirect without LOCATION, this normally indicates an incorrectly configured region; is the region \
                 right? AWS_REGION names it",
            ),
            (
                "Server returned non-2xx status code: 400 Bad Request: <Code>InvalidArgument</Code>",
                Kind::Other,
                "cannot be read: the server says 400 InvalidArgument",
            ),
        ] {
            let said = say("s3://b/x", Server::Amazon, "read", &generic(text));
            assert_eq!((said.kind, said.problem.as_str()), (kind, problem));
        }
        let asked = "Error performing PUT http://169.254.169.254/latest/api/token in 9s - HTTP error: error sending request";
        let said = say("s3://b/x", Server::Amazon, "read", &generic(asked));
        assert!(said.kind == Kind::Denied && said.problem.contains("and http://169.254.169.254 gives none"), "{said}");
        let said = say("s3://b/x", Server::Amazon, "read", &generic("non-2xx status code: 403 Forbidden: <Code>AccessDenied</Code>"));
        assert!(said.kind == Kind::Denied && said.problem.contains("AWS_ACCESS_KEY_ID"), "{said}");
    }

    #[test]
    fn addresses_of_servers_are_shown_without_what_may_be_secret() {
        for (text, shown) in [
            ("PUT http://127.0.0.1:1/b/x?sig=hush in 1s", Some("http://127.0.0.1:1")),
            ("GET https://me:hush@host:9/x", Some("https://host:9")),
            ("PUT REDACTED in 1s", None),
        ] {
            assert_eq!(origin(text).as_deref(), shown);
        }
    }
}
