//! Which states become pictures, and for how long each is shown.

/// How a file format counts time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ticks {
    /// Seconds of a tick.
    pub seconds: f64,
    /// Ticks for which a picture is shown at least.
    pub least: u32,
}

/// A picture: which state, and for how many ticks it is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cut {
    /// Index of the state in its episode.
    pub shot: usize,
    /// Ticks.
    pub ticks: u32,
}

/// Pictures a second of playback, unless the user says every how many steps one is taken.
const PICTURES_PER_SECOND: f64 = 30.0;

/// The clock of a video over all its episodes.
#[derive(Debug, Clone, PartialEq)]
pub struct Playback {
    /// Seconds of playback of one control step.
    step: f64,
    every: usize,
    ticks: Ticks,
    /// Seconds of the episodes so far.
    elapsed: f64,
}

impl Playback {
    /// A clock for control steps of `dt` seconds that are played `speed` times as fast. A picture is
    /// taken `every` so many steps (by default as often as gives thirty a second), but for those that the
    /// format cannot show for so short a time.
    pub fn new(dt: f64, speed: f64, every: Option<usize>, ticks: Ticks) -> Playback {
        let step = dt / speed;
        // A whole number of steps may fit but for rounding.
        let fitting = (1.0 / (PICTURES_PER_SECOND * step) - 1e-9).ceil();
        Playback {
            step,
            every: every.unwrap_or(fitting as usize).max(1),
            ticks,
            elapsed: 0.0,
        }
    }

    /// Seconds between two pictures.
    pub fn interval(&self) -> f64 {
        self.step * self.every as f64
    }

    /// Seconds of playback so far.
    pub fn elapsed(&self) -> f64 {
        self.elapsed
    }

    /// The pictures of the next episode, of which there are so many states. The time of each picture is
    /// rounded to ticks, not its length: rounding errors do not add up.
    pub fn cuts(&mut self, shots: usize) -> Vec<Cut> {
        let tick = |time: f64| (time / self.ticks.seconds).round() as u64;
        let start = |shot: usize| tick(self.elapsed + shot as f64 * self.step);
        let least = u64::from(self.ticks.least.max(1));

        let mut kept: Vec<usize> = Vec::new();
        for shot in (0..shots).step_by(self.every) {
            if kept
                .last()
                .is_none_or(|last| start(shot) - start(*last) >= least)
            {
                kept.push(shot);
            }
        }
        let end = start(shots);
        if kept.len() > 1 && kept.last().is_some_and(|last| end - start(*last) < least) {
            kept.pop();
        }
        let ends = kept.iter().skip(1).map(|shot| start(*shot)).chain([end]);
        let cuts = kept.iter().zip(ends).map(|(&shot, end)| Cut {
            shot,
            ticks: u32::try_from((end - start(shot)).max(least)).unwrap_or(u32::MAX),
        });
        let cuts = cuts.collect();
        self.elapsed += shots as f64 * self.step;
        cuts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CENTISECONDS: Ticks = Ticks {
        seconds: 0.01,
        least: 2,
    };

    fn ticks(cuts: &[Cut]) -> Vec<u32> {
        cuts.iter().map(|cut| cut.ticks).collect()
    }

    #[test]
    fn playback_takes_as_long_as_the_simulation() {
        // A hundred steps of each task's length, at several speeds.
        for dt in [0.04, 0.05, 0.008, 0.015, 0.01] {
            for speed in [1.0, 0.25, 3.0, 7.5] {
                for every in [None, Some(1), Some(7)] {
                    let mut playback = Playback::new(dt, speed, every, CENTISECONDS);
                    let mut total = 0;
                    for episode in 1..=3 {
                        let cuts = playback.cuts(101);
                        assert!(cuts.iter().all(|cut| cut.ticks >= 2));
                        assert!(cuts.is_sorted_by(|a, b| a.shot < b.shot));
                        assert_eq!(cuts[0].shot, 0);
                        total += ticks(&cuts).iter().sum::<u32>();
                        let expected = f64::from(episode * 101) * dt / speed;
                        let error = f64::from(total) * 0.01 - expected;
                        assert!(error.abs() < 0.0051, "{dt} {speed} {every:?}: {error}");
                    }
                }
            }
        }
    }

    #[test]
    fn pictures_come_as_often_as_the_eye_needs() {
        let every = |dt, speed| Playback::new(dt, speed, None, CENTISECONDS).every;
        assert_eq!(every(0.04, 1.0), 1);
        assert_eq!(every(0.05, 1.0), 1);
        assert_eq!(every(0.008, 1.0), 5);
        assert_eq!(every(0.05, 4.0), 3);
        assert_eq!(every(1.0 / 60.0, 1.0), 2);
    }

    #[test]
    fn delays_that_do_not_fit_are_spread() {
        // 1/30 s is no whole number of hundredths.
        let mut playback = Playback::new(1.0 / 30.0, 1.0, None, CENTISECONDS);
        assert_eq!(ticks(&playback.cuts(6)), [3, 4, 3, 3, 4, 3]);
        // 0.8 hundredths a step: pictures are left out.
        let mut playback = Playback::new(0.008, 1.0, Some(1), CENTISECONDS);
        let cuts = playback.cuts(10);
        assert_eq!(ticks(&cuts).iter().sum::<u32>(), 8);
        assert!(cuts.len() < 5);
    }

    #[test]
    fn a_single_state_is_shown_as_long_as_can_be_seen() {
        let mut playback = Playback::new(0.008, 1.0, None, CENTISECONDS);
        assert_eq!(playback.cuts(1), [Cut { shot: 0, ticks: 2 }]);
        assert!(playback.cuts(0).is_empty());
    }
}
