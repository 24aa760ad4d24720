//! Failures of a run and their exit codes.

/// Reason why there is no design.
#[derive(Debug)]
pub enum Failure {
    /// Bad input: exit code 2.
    Input(String),
    /// Disk, threads: exit code 1.
    System(String),
    /// Ctrl-C before there was a design: exit code 130.
    Interrupted,
}

impl Failure {
    /// The exit code, as that of the command `ecm`.
    pub fn code(&self) -> u8 {
        match self {
            Self::Input(_) => 2,
            Self::System(_) => 1,
            Self::Interrupted => 130,
        }
    }

    /// One message.
    pub fn message(&self) -> String {
        match self {
            Self::Input(text) | Self::System(text) => format!("error: {text}"),
            Self::Interrupted => "interrupted before there was a design: nothing was kept".into(),
        }
    }
}

impl From<ecm_doe::DesignError> for Failure {
    fn from(error: ecm_doe::DesignError) -> Self {
        match error {
            ecm_doe::DesignError::Threads { .. } => Self::System(error.to_string()),
            _ => Self::Input(error.to_string()),
        }
    }
}

impl From<ecm_poly::ModelError> for Failure {
    fn from(error: ecm_poly::ModelError) -> Self {
        Self::Input(error.to_string())
    }
}
