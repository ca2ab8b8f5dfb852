//! Why gaps were filled as they were: for people, for scripts, and for the log.

use crate::report::{Report, count};
use crate::solve::auto::Explanation;
use crate::solve::{Gap, Problem};
use crate::typeset::{Style, Tone, wrap};
use formats::Take;
use serde::Serialize;
use std::fmt::Write;

/// Why a stretch of a gap was filled as it was.
#[derive(Clone, Debug, Serialize)]
pub struct Part {
    /// First frame, the file's number.
    pub first_frame: i64,
    /// Last frame, the file's number.
    pub last_frame: i64,
    /// Predicted error, root mean square, mm.
    pub predicted_mm: f64,
    /// Number of simulated gaps that judged.
    pub simulated_gaps: usize,
    /// Their length in frames.
    pub simulated_frames: usize,
    /// Labels of the markers that experts looked at, best first.
    pub neighbours: Vec<String>,
    /// Experts, largest share first.
    pub experts: Vec<Share>,
    /// Column of the take, to find the gap.
    #[serde(skip)]
    pub(crate) marker: usize,
}

/// An expert's part in a fill.
#[derive(Clone, Debug, Serialize)]
pub struct Share {
    /// What it is: `docs/algorithm.md` explains the names.
    pub expert: String,
    /// Its share; shares sum to 1.
    pub share: f64,
    /// Its root mean square error on simulated gaps, mm; absent if there were none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error_mm: Option<f64>,
}

impl Report {
    /// Takes over what a method says about its fills.
    pub fn explain(&mut self, problem: &Problem, explanations: &[Explanation], take: &Take) {
        let label = |&column: &usize| take.display_label(problem.columns[column]);
        self.parts = explanations
            .iter()
            .map(|e| Part {
                first_frame: take.frame_label(e.gap.start),
                last_frame: take.frame_label(e.gap.end - 1),
                predicted_mm: e.predicted_mm,
                simulated_gaps: e.simulated,
                simulated_frames: e.simulated_frames,
                neighbours: e.neighbours.iter().map(label).collect(),
                experts: e
                    .experts
                    .iter()
                    .map(|(expert, share, error)| Share {
                        expert: expert.clone(),
                        share: *share,
                        error_mm: error.is_finite().then_some(*error),
                    })
                    .collect(),
                marker: problem.columns[e.gap.marker],
            })
            .collect();
    }

    /// Sorts explanations by gap.
    pub fn attach_explanations(&mut self, gaps: &[Gap]) {
        self.parts.sort_by_key(|p| (p.marker, p.first_frame));
        for (report, gap) in self.gaps.iter_mut().zip(gaps).filter(|(r, _)| r.open.is_none()) {
            // a stretch may reach beyond the gap into samples that are ignored
            let from = self.parts.partition_point(|p| (p.marker, p.last_frame) < (gap.marker, report.first_frame));
            let own = self.parts[from..].iter().take_while(|p| p.marker == gap.marker && p.first_frame <= report.last_frame);
            report.explanation = own.cloned().collect();
        }
    }

    /// For people: why each gap was filled as it was.
    pub fn explanation_text(&self, style: &Style) -> String {
        let mut out = String::new();
        for gap in &self.gaps {
            let what =
                format!("gap {}: {}, {} to {}, {}", gap.gap, gap.marker, gap.first_frame, gap.last_frame, count(gap.frames, "frame"));
            let open = gap.why.map_or_else(String::new, |why| format!(", left open: {}", why.reason()));
            for (at, line) in wrap(&(what + &open), style.text_columns() - 4).iter().enumerate() {
                let _ = writeln!(out, "{}{}", if at > 0 { "    " } else { "" }, style.toned(Tone::Title, line));
            }
            for part in &gap.explanation {
                let judged = match part.simulated_gaps {
                    0 => "nothing: too little was seen".to_owned(),
                    n => format!("{} of {}", count(n, "simulated gap"), count(part.simulated_frames, "frame")),
                };
                let frames = format!("{} to {}", part.first_frame, part.last_frame);
                out.push_str(&style.item("frames", &format!("{frames}: predicted error {:.1} mm, judged by {judged}", part.predicted_mm)));
                if !part.neighbours.is_empty() {
                    let shown = part.neighbours.iter().take(8).cloned().collect::<Vec<_>>().join(" ");
                    let more = part.neighbours.len().saturating_sub(8);
                    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
                    out.push_str(&style.item("neighbours", &format!("{shown}{more}")));
                }
                for share in part.experts.iter().take(5) {
                    let error = share.error_mm.map_or_else(String::new, |e| format!(", error {e:.1} mm on simulated gaps"));
                    out.push_str(&style.item(&format!("{:>3.0} %", 100.0 * share.share), &format!("{}{error}", share.expert)));
                }
            }
        }
        out
    }
}
