//! What several examples share: random wrenches of the paper's Table I box.

/// A linear congruential generator (Knuth, MMIX): enough to draw loads.
pub struct Draw(pub u64);

impl Draw {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        low + (high - low) * (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Force in N and moment in N m.
    pub fn wrench(&mut self) -> [f64; 6] {
        let mut h = [self.between(-110.0, 30.0), 0.0, 0.0, 0.0, 0.0, 0.0];
        h[1..3]
            .iter_mut()
            .for_each(|v| *v = self.between(-100.0, 100.0));
        h[3..].iter_mut().for_each(|v| *v = self.between(-5.0, 5.0));
        h
    }
}
