//! A place that is a prefix in a bucket, of Amazon S3, Google Cloud Storage, Azure Blob Storage, or a server that speaks as one of them.
//!
//! Credentials, endpoints and timeouts come from the environment, in the words that `object_store` knows.
//! What a server answers is put into words in `server`.
//!
//! One thread of the runtime moves the bytes; whoever calls waits. What is handed over while listing or reading is handed over outside of
//! the runtime, so that it may call the place again.

use super::server::{Server, is_without_bucket, say, say_of_settings};
use super::{Entry, Kind, Mode, StoreError, is_unfinished, join, local};
use futures_util::StreamExt;
use object_store::aws::{AmazonS3Builder, AmazonS3ConfigKey, S3CopyIfNotExists};
use object_store::azure::{AzureConfigKey, MicrosoftAzureBuilder};
use object_store::gcp::{GoogleCloudStorageBuilder, GoogleConfigKey};
use object_store::path::Path as Location;
use object_store::{BackoffConfig, ClientConfigKey, GetResult, ObjectStore, ObjectStoreExt, PutMode, PutOptions, PutPayload, RetryConfig};
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use tokio::runtime::{Builder, Runtime};

/// What goes in one request, in bytes; more goes in parts.
const SINGLE: u64 = 32 << 20;

/// The size of a part. Servers take 10,000 of them, and none but the last below 5 MiB.
const PART: u64 = 16 << 20;

/// What S3 copies in one request: <https://docs.aws.amazon.com/AmazonS3/latest/API/API_UploadPartCopy.html>.
const LARGEST_COPY: u64 = 5 << 30;

/// How often something is created again if it was said to be there and is not.
const CREATIONS: usize = 3;

/// Connections to a bucket, and a prefix in it.
#[derive(Clone)]
pub(super) struct Bucket {
    store: Arc<dyn ObjectStore>,
    runtime: Arc<Runtime>,
    server: Server,
    /// Without slashes at its ends; may be empty.
    prefix: String,
}

/// How often and how long a request is repeated that a server could not serve.
fn patience() -> RetryConfig {
    let backoff = BackoffConfig { init_backoff: Duration::from_millis(300), max_backoff: Duration::from_secs(10), base: 2.0 };
    RetryConfig { backoff, max_retries: 8, retry_timeout: Duration::from_secs(90) }
}

/// Settings of connections that the environment does not set.
fn connection(prefix: &'static str) -> impl Iterator<Item = (ClientConfigKey, &'static str)> {
    // The longest wait for the next bytes of an answer has to leave time for SINGLE bytes to get there.
    // A whole answer may take long: it may be large.
    [
        (ClientConfigKey::ConnectTimeout, "CONNECT_TIMEOUT", "10 seconds"),
        (ClientConfigKey::ReadTimeout, "READ_TIMEOUT", "3 minutes"),
        (ClientConfigKey::Timeout, "TIMEOUT", "1 hour"),
        (ClientConfigKey::PoolIdleTimeout, "POOL_IDLE_TIMEOUT", "20 seconds"),
    ]
    .into_iter()
    .filter(move |(_, name, _)| std::env::var_os(format!("{prefix}{name}")).is_none())
    .map(|(key, _, value)| (key, value))
}

impl Bucket {
    pub(super) fn new(shown: &str, scheme: &str, bucket: &str, prefix: &str) -> Result<Bucket, StoreError> {
        // Fails if somebody has chosen before, which is as good.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let server = Server::of_scheme(scheme);
        let store: Result<Arc<dyn ObjectStore>, _> = match server {
            Server::Amazon => {
                let builder = AmazonS3Builder::from_env().with_bucket_name(bucket).with_retry(patience()).with_disable_bulk_delete(true);
                let builder = connection("AWS_").fold(builder, |b, (key, value)| b.with_config(AmazonS3ConfigKey::Client(key), value));
                let builder = match builder.get_config_value(&AmazonS3ConfigKey::CopyIfNotExists) {
                    Some(_) => builder,
                    None => builder.with_copy_if_not_exists(S3CopyIfNotExists::Multipart),
                };
                builder.build().map(|store| Arc::new(store) as _)
            }
            Server::Google => {
                let builder = GoogleCloudStorageBuilder::from_env().with_bucket_name(bucket).with_retry(patience());
                let builder = connection("GOOGLE_").fold(builder, |b, (key, value)| b.with_config(GoogleConfigKey::Client(key), value));
                builder.build().map(|store| Arc::new(store) as _)
            }
            Server::Azure => {
                let builder = MicrosoftAzureBuilder::from_env().with_container_name(bucket).with_retry(patience());
                let builder = connection("AZURE_").fold(builder, |b, (key, value)| b.with_config(AzureConfigKey::Client(key), value));
                builder.build().map(|store| Arc::new(store) as _)
            }
        };
        let store = store.map_err(|error| say_of_settings(shown, server, &error))?;
        let runtime = Builder::new_multi_thread().worker_threads(1).thread_name("buckets").enable_all().build();
        let runtime = runtime.map_err(|error| StoreError::io(shown, "used", &error))?;
        Self::within(shown, prefix)?;
        Ok(Bucket { store, runtime: Arc::new(runtime), server, prefix: prefix.to_owned() })
    }

    pub(super) fn join(&self, name: &str) -> Bucket {
        let prefix = if self.prefix.is_empty() { name.to_owned() } else { join(&self.prefix, name) };
        Bucket { prefix, ..self.clone() }
    }

    /// The location of a key, as it is: nothing is encoded, or names would not come back.
    fn within(place: &str, key: &str) -> Result<Location, StoreError> {
        Location::parse(key).map_err(|error| StoreError {
            place: place.to_owned(),
            kind: Kind::Unsupported,
            problem: format!("no object of that name can be used: {error}; rename it"),
        })
    }

    /// How a name is shown, and where it is.
    fn locate(&self, place: &str, name: &str) -> Result<(String, Location), StoreError> {
        let shown = join(place, name);
        let key = self.join(name).prefix;
        if self.server == Server::Azure && key.contains('\\') {
            let problem = "Azure makes slashes of backslashes, so that the name would not come back; rename it".to_owned();
            return Err(StoreError { place: shown, kind: Kind::Unsupported, problem });
        }
        let location = Self::within(&shown, &key)?;
        Ok((shown, location))
    }

    pub(super) fn list(
        &self,
        place: &str,
        each: &mut dyn FnMut(Result<Entry, StoreError>) -> Result<(), StoreError>,
    ) -> Result<(), StoreError> {
        let mut listing = self.store.list(Some(&Self::within(place, &self.prefix)?));
        // Consoles make folders by objects without content, whose names end with a slash that is lost here; what is within comes next.
        let mut held: Option<Entry> = None;
        while let Some(found) = self.runtime.block_on(listing.next()) {
            let found = found.map_err(|error| say(place, self.server, "listed", &error))?;
            let name = match found.location.as_ref().strip_prefix(&self.prefix) {
                Some(name) if self.prefix.is_empty() => name,
                // the prefix itself, as such a folder, has no name in it
                name => name.and_then(|name| name.strip_prefix('/')).unwrap_or_default(),
            };
            if let Some(held) = held.take().filter(|held| !name.strip_prefix(&held.name).is_some_and(|rest| rest.starts_with('/'))) {
                each(Ok(held))?;
            }
            if name.is_empty() || is_unfinished(name) {
                continue;
            }
            let entry = Entry {
                name: name.to_owned(),
                bytes: found.size,
                modified: Some(SystemTime::from(found.last_modified)),
                version: found.e_tag,
            };
            if entry.bytes == 0 {
                held = Some(entry);
            } else {
                each(Ok(entry))?;
            }
        }
        held.map_or(Ok(()), |held| each(Ok(held)))
    }

    /// An object, of which the first bytes are on their way; None if it is not there.
    fn open(&self, shown: &str, location: &Location) -> Result<Option<GetResult>, StoreError> {
        match self.runtime.block_on(self.store.get(location)) {
            Ok(object) => Ok(Some(object)),
            Err(error) => self.unless_not_there(shown, "read", &error).map(|()| None),
        }
    }

    /// Fine if an object is not there, but not if that is because there is no such bucket.
    fn unless_not_there(&self, shown: &str, done: &str, error: &object_store::Error) -> Result<(), StoreError> {
        let said = say(shown, self.server, done, error);
        if said.kind == Kind::NotFound && !is_without_bucket(error) { Ok(()) } else { Err(said) }
    }

    fn drain(&self, shown: &str, object: GetResult, each: &mut dyn FnMut(&[u8]) -> Result<(), StoreError>) -> Result<(), StoreError> {
        let mut blocks = object.into_stream();
        while let Some(block) = self.runtime.block_on(blocks.next()) {
            each(&block.map_err(|error| say(shown, self.server, "read", &error))?)?;
        }
        Ok(())
    }

    pub(super) fn read(&self, place: &str, name: &str, limit: u64) -> Result<Option<Vec<u8>>, StoreError> {
        let (shown, location) = self.locate(place, name)?;
        let Some(object) = self.open(&shown, &location)? else { return Ok(None) };
        let length = object.meta.size;
        let mut bytes = Vec::new();
        if length > limit {
            return Err(StoreError::too_large(shown, length, limit));
        }
        self.drain(&shown, object, &mut |block| {
            bytes.extend_from_slice(block);
            Ok(())
        })?;
        Ok(Some(bytes))
    }

    pub(super) fn blocks(
        &self,
        place: &str,
        name: &str,
        each: &mut dyn FnMut(&[u8]) -> Result<(), StoreError>,
    ) -> Result<bool, StoreError> {
        let (shown, location) = self.locate(place, name)?;
        let Some(object) = self.open(&shown, &location)? else { return Ok(false) };
        self.drain(&shown, object, each).map(|()| true)
    }

    pub(super) fn fetch(&self, place: &str, name: &str, to: &Path) -> Result<(), StoreError> {
        let (shown, location) = self.locate(place, name)?;
        let not_there = || StoreError::io(&shown, "read", &io::ErrorKind::NotFound.into());
        let object = self.open(&shown, &location)?.ok_or_else(not_there)?;
        local::into_file(to, |each| self.drain(&shown, object, each).map(|()| true)).map(drop)
    }

    fn head(&self, shown: &str, location: &Location) -> Result<bool, StoreError> {
        match self.runtime.block_on(self.store.head(location)) {
            Ok(_) => Ok(true),
            Err(error) => self.unless_not_there(shown, "looked for", &error).map(|()| false),
        }
    }

    pub(super) fn entry(&self, place: &str, name: &str) -> Result<Option<Entry>, StoreError> {
        let (shown, location) = self.locate(place, name)?;
        match self.runtime.block_on(self.store.head(&location)) {
            Ok(found) => {
                let modified = Some(SystemTime::from(found.last_modified));
                Ok(Some(Entry { name: name.to_owned(), bytes: found.size, modified, version: found.e_tag }))
            }
            Err(error) => self.unless_not_there(&shown, "looked for", &error).map(|()| None),
        }
    }

    pub(super) fn remove(&self, place: &str, name: &str) -> Result<(), StoreError> {
        let (shown, location) = self.locate(place, name)?;
        match self.runtime.block_on(self.store.delete(&location)) {
            Ok(()) => Ok(()),
            Err(error) => self.unless_not_there(&shown, "removed", &error),
        }
    }

    pub(super) fn write(&self, place: &str, name: &str, bytes: &[u8], mode: Mode) -> Result<bool, StoreError> {
        let (shown, location) = self.locate(place, name)?;
        self.send(&shown, &location, &PutPayload::from(bytes.to_vec()), mode)
    }

    fn send(&self, shown: &str, location: &Location, bytes: &PutPayload, mode: Mode) -> Result<bool, StoreError> {
        let put = || {
            let options = PutOptions::from(if mode == Mode::Create { PutMode::Create } else { PutMode::Overwrite });
            self.runtime.block_on(self.store.put_opts(location, bytes.clone(), options)).map(drop)
        };
        if mode == Mode::Replace {
            return put().map(|()| true).map_err(|error| say(shown, self.server, "written", &error));
        }
        self.create(shown, location, put)
    }

    /// What `put` does on the condition that nothing has the name.
    fn create(&self, shown: &str, location: &Location, put: impl Fn() -> Result<(), object_store::Error>) -> Result<bool, StoreError> {
        let mut left = CREATIONS;
        loop {
            left -= 1;
            match put() {
                Ok(()) => return Ok(true),
                // S3 says the same (409) if somebody else was about to write or remove the object: then look, and try again
                Err(object_store::Error::AlreadyExists { .. }) if self.head(shown, location)? => return Ok(false),
                Err(object_store::Error::AlreadyExists { .. }) if left > 0 => {}
                Err(error) => return Err(say(shown, self.server, "written", &error)),
            }
        }
    }

    pub(super) fn put(&self, place: &str, name: &str, from: &Path, mode: Mode) -> Result<bool, StoreError> {
        let (shown, location) = self.locate(place, name)?;
        let of_from = |error: io::Error| StoreError::io(from.display().to_string(), "read", &error);
        let file = File::open(from).map_err(of_from)?;
        let length = file.metadata().map_err(of_from)?.len();
        let mut parts = Parts { file, from };
        let there = if length <= SINGLE {
            self.send(&shown, &location, &parts.next(SINGLE + 1)?.unwrap_or_default(), mode)?
        } else {
            self.send_parts(&shown, &location, &mut parts, length, mode)?
        };
        if there {
            // it is where it should be; what is left of it here is not worth an error
            let _ = std::fs::remove_file(from);
        }
        Ok(there)
    }

    /// Uploads in parts. No server takes a condition with that, or `object_store` does not tell it: [how it is created](super::Place::put).
    fn send_parts(&self, shown: &str, location: &Location, parts: &mut Parts<'_>, length: u64, mode: Mode) -> Result<bool, StoreError> {
        if mode == Mode::Create && self.head(shown, location)? {
            return Ok(false);
        }
        // Azure may still be copying when it says yes, and then the hidden object must not go.
        let copied = mode == Mode::Create
            && match self.server {
                Server::Amazon => length <= LARGEST_COPY,
                Server::Google => true,
                Server::Azure => false,
            };
        if !copied {
            return self.upload(shown, location, parts, &|| Ok(mode == Mode::Replace || !self.head(shown, location)?));
        }
        let (folder, last) = location.as_ref().rsplit_once('/').unwrap_or(("", location.as_ref()));
        let hidden = Self::within(shown, &format!("{folder}/.{last}.{}.part", local::random_name()))?;
        self.upload(shown, &hidden, parts, &|| Ok(true))?;
        let there = self.create(shown, location, || self.runtime.block_on(self.store.copy_if_not_exists(&hidden, location)));
        // if it stays, it is hidden; what happened to the copy matters more
        let _ = self.runtime.block_on(self.store.delete(&hidden));
        there
    }

    /// Uploads all parts, and makes an object of them if `may` says so in the last moment.
    fn upload(
        &self,
        shown: &str,
        location: &Location,
        parts: &mut Parts<'_>,
        may: &dyn Fn() -> Result<bool, StoreError>,
    ) -> Result<bool, StoreError> {
        let written = |error: object_store::Error| say(shown, self.server, "written", &error);
        let mut upload = self.runtime.block_on(self.store.put_multipart(location)).map_err(written)?;
        let mut send_all = || {
            while let Some(part) = parts.next(PART)? {
                self.runtime.block_on(upload.put_part(part)).map_err(written)?;
            }
            if !may()? {
                return Ok(false);
            }
            match self.runtime.block_on(upload.complete()) {
                Ok(_) => Ok(true),
                // Azure forgets the parts of everybody else when somebody makes an object of theirs
                Err(error) if error.to_string().contains("InvalidBlockList") => {
                    if may()? {
                        Err(StoreError { kind: Kind::Again, ..written(error) })
                    } else {
                        Ok(false)
                    }
                }
                Err(error) => Err(written(error)),
            }
        };
        let done = send_all();
        if !matches!(done, Ok(true)) {
            // parts that are left behind cost money until the bucket's rules remove them; nothing better can be done than to try
            let _ = self.runtime.block_on(upload.abort());
        }
        done
    }
}

/// A file in pieces.
struct Parts<'a> {
    file: File,
    from: &'a Path,
}

impl Parts<'_> {
    /// At most `length` bytes; None at the end.
    fn next(&mut self, length: u64) -> Result<Option<PutPayload>, StoreError> {
        let mut bytes = Vec::new();
        let read = (&mut self.file).take(length).read_to_end(&mut bytes);
        read.map_err(|error| StoreError::io(self.from.display().to_string(), "read", &error))?;
        Ok((!bytes.is_empty()).then(|| bytes.into()))
    }
}
