//! How a batch stands, from its ledgers and plans.

use super::ledger::{self, Begun, Outcome, Record, Stop, TakeRecord};
use super::session::{kept_plan, known};
use super::store::Place;
use super::{BatchError, OWN_FOLDER};
use crate::report::{count, lines};
use crate::typeset::{Style, Tone, cut};
use serde::Serialize;
use std::collections::BTreeMap;

/// So many takes that need a look are shown; `--json` has them all.
const MOST_SHOWN: usize = 20;

/// How a batch stands.
#[derive(Clone, Debug, Default, Serialize)]
#[serde(tag = "message_type", rename = "status")]
pub struct Status {
    /// SHA-256 of the plan that was run last; absent for a folder that is watched.
    pub plan: Option<String>,
    /// Its takes; those that came, for a folder that is watched.
    pub takes: u64,
    /// Repaired.
    pub done: u64,
    /// Of these, with something to look at.
    pub remarked: u64,
    /// Put aside.
    pub quarantined: u64,
    /// Kept from being repaired by something else; the next run tries again.
    pub failed: u64,
    /// Not yet tried.
    pub open: u64,
    /// The last attempt at each shard.
    pub shards: Vec<ShardStatus>,
    /// Takes that were put aside or failed.
    #[serde(skip)]
    pub troubled: Vec<TakeRecord>,
}

/// The last attempt at a shard.
#[derive(Clone, Debug, Serialize)]
pub struct ShardStatus {
    /// Counted from 0.
    pub shard: u32,
    /// Number of shards.
    pub shards: u32,
    /// Number of the attempt.
    pub attempt: u32,
    /// When it began.
    pub began: String,
    /// Where.
    pub host: String,
    /// `local` or `ray`.
    pub engine: String,
    /// When its last take was accounted for, or it ended.
    pub last: String,
    /// How it ended; absent if it runs, or was ended from outside.
    pub stop: Option<Stop>,
}

impl Status {
    /// Reads the ledgers, and the plan that was run last.
    ///
    /// # Errors
    /// There is no batch, or its records cannot be read.
    pub fn read(out: &Place) -> Result<Self, BatchError> {
        let mut attempts: BTreeMap<(Option<String>, u32, u32), ShardStatus> = BTreeMap::new();
        let mut newest: Option<Begun> = None;
        let mut now: Option<(Option<String>, u32, u32)> = None;
        let mut ledger = String::new();
        let mut accounted: BTreeMap<String, TakeRecord> = BTreeMap::new();
        ledger::read_all(out, &mut |name, record| {
            if name != ledger {
                name.clone_into(&mut ledger);
                now = None;
            }
            match record {
                Record::Begun(begun) => {
                    let key = (begun.plan.clone(), begun.shard, begun.shards);
                    let attempt = name.rsplit('-').next().and_then(|number| number.parse().ok()).unwrap_or(0);
                    let status = ShardStatus {
                        shard: begun.shard,
                        shards: begun.shards,
                        attempt,
                        began: begun.time.clone(),
                        host: begun.host.clone(),
                        engine: begun.engine.clone(),
                        last: begun.time.clone(),
                        stop: None,
                    };
                    attempts.insert(key.clone(), status);
                    now = Some(key);
                    if newest.as_ref().is_none_or(|newest| newest.time <= begun.time) {
                        newest = Some(begun);
                    }
                }
                Record::Take(take) => {
                    if let Some(status) = now.as_ref().and_then(|key| attempts.get_mut(key)) {
                        status.last.clone_from(&take.time);
                    }
                    let identity = take.planned.clone().unwrap_or_else(|| take.path.clone());
                    let newer = accounted.get(&known(&identity, &take.path)).is_none_or(|before| before.time <= take.time);
                    if newer {
                        accounted.insert(known(&identity, &take.path), take);
                    }
                }
                Record::Ended(ended) => {
                    if let Some(status) = now.as_ref().and_then(|key| attempts.get_mut(key)) {
                        status.last = ended.time;
                        status.stop = Some(ended.stop);
                    }
                }
            }
        })?;
        let Some(newest) = newest else {
            return Err(BatchError { text: format!("{out}: holds no batch: there is no {OWN_FOLDER}/ledger in it"), again: false });
        };
        let mut status = Self { plan: newest.plan.clone(), ..Self::default() };
        status.shards = attempts.into_iter().filter(|((plan, ..), _)| *plan == newest.plan).map(|(_, shard)| shard).collect();
        // only the latest division into shards counts
        status.shards.retain(|shard| shard.shards == newest.shards);
        if let Some(plan) = &newest.plan {
            status.count_plan(out, plan, &accounted)?;
        } else {
            let mut last: BTreeMap<String, TakeRecord> = BTreeMap::new();
            for take in accounted.into_values() {
                if last.get(&take.path).is_none_or(|before| before.time <= take.time) {
                    last.insert(take.path.clone(), take);
                }
            }
            for take in last.values() {
                status.takes += 1;
                status.add(take);
            }
        }
        Ok(status)
    }

    fn count_plan(&mut self, out: &Place, plan: &str, accounted: &BTreeMap<String, TakeRecord>) -> Result<(), BatchError> {
        kept_plan(out, plan, &mut |header, take| {
            self.takes += 1;
            match accounted.get(&known(&take.identity(header), &take.path)) {
                Some(record) => self.add(record),
                None => self.open += 1,
            }
        })?;
        Ok(())
    }

    fn add(&mut self, take: &TakeRecord) {
        match take.outcome {
            Outcome::Done | Outcome::Skipped => {
                self.done += 1;
                self.remarked += u64::from(take.exit_code == Some(3));
            }
            Outcome::Quarantined => self.quarantined += 1,
            Outcome::Failed => self.failed += 1,
        }
        if matches!(take.outcome, Outcome::Quarantined | Outcome::Failed) {
            self.troubled.push(take.clone());
        }
    }

    /// 0 if every take is repaired and there is nothing to look at, else 3.
    pub fn exit_code(&self) -> u8 {
        if self.remarked + self.quarantined + self.failed + self.open > 0 { 3 } else { 0 }
    }

    /// For scripts: takes that were put aside or failed, then the whole.
    pub fn json(&self) -> String {
        let troubled: Vec<Record> = self.troubled.iter().cloned().map(Record::Take).collect();
        lines(&troubled) + &lines(std::slice::from_ref(self))
    }

    /// For people.
    pub fn text(&self, out: &Place, style: &Style) -> String {
        let mut text = format!("{}\n", style.toned(Tone::Title, out.shown()));
        let plan =
            self.plan.as_deref().map_or("a folder that is watched".to_owned(), |plan| format!("plan {}", &plan[..8.min(plan.len())]));
        text += &style.item("takes", &format!("{} of {plan}", count(self.takes as usize, "take")));
        let look = if self.remarked > 0 { format!(", {} of them to look at", self.remarked) } else { String::new() };
        text += &style.item("repaired", &format!("{}{look}", self.done));
        for (head, number) in [("put aside", self.quarantined), ("failed", self.failed), ("not yet", self.open)] {
            if number > 0 {
                text += &style.item(head, &number.to_string());
            }
        }
        for shard in &self.shards {
            let state = match shard.stop {
                None => "began, and has not ended",
                Some(Stop::Complete) => "complete",
                Some(Stop::Interrupted) => "was interrupted",
                Some(Stop::DiskFull) => "stopped: no room on the disk",
                Some(Stop::TooManyFailures) => "stopped: too many takes failed",
                Some(Stop::Engine) => "stopped: its engine was gone",
            };
            let of = format!("shard {}/{}", shard.shard, shard.shards);
            text += &style
                .item(&of, &format!("{state} (attempt {} on {}, {}, last word {})", shard.attempt, shard.host, shard.engine, shard.last));
        }
        if !self.troubled.is_empty() {
            text.push('\n');
        }
        for take in self.troubled.iter().take(MOST_SHOWN) {
            let line = format!("{}: {}", take.path, take.reason.as_deref().unwrap_or("no reason given"));
            text = text + "  " + &cut(&formats::printable(&line), 400, style.ascii) + "\n";
        }
        if self.troubled.len() > MOST_SHOWN {
            text = text + "  and " + &(self.troubled.len() - MOST_SHOWN).to_string() + " more; --json has them all\n";
        }
        text
    }
}
