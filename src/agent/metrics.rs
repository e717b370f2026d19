//! What learning tells of itself: numbers by name.

/// Numbers by name. The names are those of the columns of `train.csv` (`run::schema`).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Metrics(Vec<(&'static str, f64)>);

impl Metrics {
    /// Adds a number.
    pub fn set(&mut self, name: &'static str, value: impl Into<f64>) {
        self.0.push((name, value.into()));
    }

    /// The number `name`, if it was told.
    pub fn get(&self, name: &str) -> Option<f64> {
        let found = self.0.iter().find(|(found, _)| *found == name);
        found.map(|(_, value)| *value)
    }

    /// All of them, in the order in which they were told.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, f64)> + '_ {
        self.0.iter().copied()
    }

    /// Name of the first number that is not finite.
    pub fn not_finite(&self) -> Option<&'static str> {
        self.iter()
            .find_map(|(name, value)| (!value.is_finite()).then_some(name))
    }
}
