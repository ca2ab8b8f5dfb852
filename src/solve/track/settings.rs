//! How a body is followed.

/// Which algorithm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Distances from planes, a sigma that is lowered step by step, limits that have weight, prediction, and a search for limbs that were lost.
    #[default]
    Planes,
    /// The report's: distances from vertices, a sigma that follows the residuals, limits as they are printed, no prediction.
    Report,
}

/// Numbers of the algorithm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Which algorithm.
    pub method: Method,
    /// Standard deviation of the mixture at the beginning of a frame, cm.
    pub sigma0_cm: f64,
    /// The standard deviation at the end of a frame; with [`Method::Report`] the least, cm.
    pub sigma_end_cm: f64,
    /// The least cosine between the normals of a point and its vertex (the report's NThresh).
    pub cosine: f64,
    /// What the class of points that belong to nothing has against a part at distance 0 (the report's Eoutlier).
    pub outlier: f64,
    /// Rounds of EM for each frame.
    pub rounds: u32,
    /// What is added to the diagonal of the normal equations (the report's epsilon).
    pub damping: f64,
    /// How much distances along the surface count, against those from it.
    pub along: f64,
    /// The share of the last motion that is expected to go on.
    pub prediction: f64,
    /// How strongly a frame is pulled towards what was expected, against its data.
    pub pull: f64,
    /// The weight of joint limits, against that of the data of their joints; 1 and no data with [`Method::Report`].
    pub limit: f64,
    /// How far vertices are apart, cm.
    pub spacing_cm: f64,
    /// How many standard deviations away a part still counts.
    pub reach: f64,
}

impl Settings {
    /// What a method does if nothing is said.
    pub fn of(method: Method) -> Self {
        let planes = Self {
            method,
            sigma0_cm: 4.0,
            sigma_end_cm: 1.0,
            cosine: 0.6,
            outlier: 0.1,
            rounds: 12,
            damping: 0.1,
            along: 0.1,
            prediction: 0.9,
            pull: 1e-3,
            limit: 1.0,
            spacing_cm: 1.5,
            reach: 3.0,
        };
        match method {
            Method::Planes => planes,
            Method::Report => {
                Self { sigma_end_cm: 0.05, rounds: 10, along: 1.0, spacing_cm: 0.0, reach: 4.0, prediction: 0.0, pull: 0.0, ..planes }
            }
        }
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self::of(Method::default())
    }
}
