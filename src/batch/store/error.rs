//! What can go wrong with a place, and what can be done about it.

use std::io;

/// Why something could not be read from a place or written to it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{place}: {problem}")]
pub struct StoreError {
    /// Where: the place, or one file in it.
    pub place: String,
    /// What can be done about it.
    pub kind: Kind,
    /// What was found, what was expected, the way out.
    pub problem: String,
}

/// What can be done about an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// It is not there: check the name.
    NotFound,
    /// It is not allowed: set permissions or credentials.
    Denied,
    /// Nothing more fits: make room.
    Full,
    /// It may work later, without anything being done.
    Again,
    /// It cannot work: name it otherwise.
    Unsupported,
    /// None of that.
    Other,
}

impl StoreError {
    /// What the system said about `place` when it was to be `done`: read, written, ...
    pub(super) fn io(place: impl Into<String>, done: &str, error: &io::Error) -> StoreError {
        let kind = kind_of(error);
        let way_out = match kind {
            Kind::NotFound => "; is the name right?",
            Kind::Denied => "; check who owns it and what its permissions are",
            Kind::Full => "; free some space and run the same command again",
            Kind::Again => "; run the same command again",
            Kind::Unsupported | Kind::Other => "",
        };
        StoreError { place: place.into(), kind, problem: format!("cannot be {done}: {error}{way_out}") }
    }

    pub(super) fn too_large(place: impl Into<String>, bytes: u64, limit: u64) -> StoreError {
        let problem = format!("has {bytes} bytes, and at most {limit} were expected here; is it what it should be?");
        StoreError { place: place.into(), kind: Kind::Other, problem }
    }
}

fn kind_of(error: &io::Error) -> Kind {
    use io::ErrorKind as E;
    match error.kind() {
        E::NotFound => Kind::NotFound,
        E::PermissionDenied | E::ReadOnlyFilesystem => Kind::Denied,
        E::StorageFull | E::QuotaExceeded => Kind::Full,
        E::TimedOut
        | E::Interrupted
        | E::WouldBlock
        | E::ResourceBusy
        | E::StaleNetworkFileHandle
        | E::OutOfMemory
        | E::ConnectionAborted
        | E::ConnectionRefused
        | E::ConnectionReset
        | E::HostUnreachable
        | E::NetworkDown
        | E::NetworkUnreachable
        | E::NotConnected => Kind::Again,
        E::InvalidFilename | E::Unsupported | E::NotADirectory | E::IsADirectory => Kind::Unsupported,
        _ => Kind::Other,
    }
}

/// Where credentials come from, by the scheme of the address.
pub(super) fn credentials(scheme: &str) -> &'static str {
    match scheme {
        "s3" => {
            "set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY (and AWS_SESSION_TOKEN), or run where an instance or a pod has a role; AWS_REGION \
             names the region, AWS_ENDPOINT_URL another server than Amazon's; profiles in ~/.aws are not read"
        }
        "gs" => {
            "set GOOGLE_APPLICATION_CREDENTIALS to the file of a service account (or GOOGLE_SERVICE_ACCOUNT_KEY to its content), or run where a \
             machine or a pod has one"
        }
        _ => {
            "set AZURE_STORAGE_ACCOUNT_NAME, and AZURE_STORAGE_ACCOUNT_KEY or AZURE_STORAGE_SAS_KEY or AZURE_CLIENT_ID, AZURE_CLIENT_SECRET and \
             AZURE_TENANT_ID, or run where a machine or a pod has an identity"
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_system_says_leads_to_what_can_be_done() {
        #[cfg(target_os = "linux")]
        for (code, kind) in [
            (2, Kind::NotFound),
            (13, Kind::Denied),
            (30, Kind::Denied),
            (28, Kind::Full),
            (122, Kind::Full),
            (110, Kind::Again),
            (116, Kind::Again),
            (36, Kind::Unsupported),
            (5, Kind::Other),
        ] {
            assert_eq!(kind_of(&io::Error::from_raw_os_error(code)), kind, "{code}");
        }
        let error = StoreError::io("out/walk.c3d", "written", &io::ErrorKind::StorageFull.into());
        assert_eq!(error.to_string(), "out/walk.c3d: cannot be written: no storage space; free some space and run the same command again");
    }
}
