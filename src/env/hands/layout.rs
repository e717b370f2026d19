//! Where each family of hand tasks puts hands, objects and goals: figures as published.

/// A box in space: lower and upper corner, in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// Lowest coordinates.
    pub low: [f64; 3],
    /// Highest coordinates.
    pub high: [f64; 3],
}

impl Region {
    /// The point in the middle.
    pub fn centre(&self) -> [f64; 3] {
        [0, 1, 2].map(|i| (self.low[i] + self.high[i]) / 2.0)
    }
}

/// Where a hand is mounted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mount {
    /// Position in metres.
    pub position: [f64; 3],
    /// Quaternion. Published as rounded angles, hence not quite right angles.
    pub quaternion: [f64; 4],
}

/// Where an object and its target are before anything moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Position of the object, in metres.
    pub object: [f64; 3],
    /// Position of the target, in metres.
    pub target: [f64; 3],
}

/// From where a scene is looked at: along the x axis, towards lower x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// The point in the middle of the picture, in metres.
    pub middle: [f64; 3],
    /// Metres from there.
    pub distance: f64,
    /// Angle at which the camera looks down, in degrees.
    pub elevation: f64,
}

/// How an episode begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Beginning {
    /// From the initial state, the object turned at random (pens are not), then left to settle.
    Settled,
    /// In the state of a hand that is about to throw, with the object at this position.
    Poised([f64; 3]),
}

/// A family of tasks that differ in their object and reward only.
#[derive(Debug, PartialEq)]
pub struct Layout {
    /// Name of its scenes.
    pub name: &'static str,
    /// The hands, one or two.
    pub mounts: &'static [Mount],
    /// Whether the mounts move (six joints each).
    pub moving: bool,
    /// Height of the floor.
    pub floor: f64,
    /// What its camera sees: both hands in full, or the fingers of one.
    pub view: View,
    /// The objects, one or two.
    pub places: &'static [Place],
    /// Whether the target of a pen starts turned as the pen does.
    pub turned_targets: bool,
    /// How an episode begins.
    pub beginning: Beginning,
    /// The two regions in which goals are drawn: on the side of hand 1, on the side of hand 2.
    pub goals: [Region; 2],
    /// In the exponent of the dense reward: weight of the whole, and of the distance in metres against
    /// the angle in radians.
    pub reward: [f64; 2],
}

const PALM_UP_1: [f64; 4] = [
    9.381839456086129e-07,
    9.38187391756999e-07,
    -0.7071080798588513,
    0.707105482510614,
];
const PALM_UP_2: [f64; 4] = [
    -0.7071080798569841,
    0.7071054825112364,
    -3.4461483862029227e-12,
    1.8763713373639604e-06,
];
const UPRIGHT_1: [f64; 4] = [1.0, 0.0, 0.0, 0.0];
const UPRIGHT_2: [f64; 4] = [0.0007963267107332633, 0.0, 0.0, 0.9999996829318346];

const fn mount(position: [f64; 3], quaternion: [f64; 4]) -> Mount {
    Mount {
        position,
        quaternion,
    }
}

const fn view(middle: [f64; 3], distance: f64, elevation: f64) -> View {
    View {
        middle,
        distance,
        elevation,
    }
}

const fn place(object: [f64; 3], target: [f64; 3]) -> Place {
    Place { object, target }
}

const fn region(low: [f64; 3], high: [f64; 3]) -> Region {
    Region { low, high }
}

/// Nowhere: the family has no goals.
const NOWHERE: Region = region([0.0; 3], [0.0; 3]);

const CATCH_REWARD: [f64; 2] = [0.2, 50.0];

/// One hand that holds a pen.
pub static SPIN: Layout = Layout {
    name: "spin",
    mounts: &[mount([1.0, 1.25, 0.15], PALM_UP_1)],
    moving: false,
    floor: -0.2,
    view: view([1.0, 0.845, 0.18], 0.36, 45.0),
    places: &[place([1.0, 0.87, 0.2], [1.0, 0.87, 0.2])],
    turned_targets: true,
    beginning: Beginning::Settled,
    goals: [NOWHERE; 2],
    reward: [0.0; 2],
};

/// Two fixed hands, fingers against fingers.
pub static HAND_OVER: Layout = Layout {
    name: "handover",
    mounts: &[
        mount([1.0, 1.25, 0.15], PALM_UP_1),
        mount([1.0, 0.25, 0.15], PALM_UP_2),
    ],
    moving: false,
    floor: 0.0,
    view: view([1.0, 0.75, 0.17], 1.1, 40.0),
    places: &[place([1.0, 0.87, 0.2], [1.04, 0.89, 0.2])],
    turned_targets: true,
    beginning: Beginning::Settled,
    goals: [
        region([0.96, 0.81, 0.2], [1.04, 0.89, 0.26]),
        region([0.96, 0.6, 0.2], [1.04, 0.68, 0.26]),
    ],
    reward: [1.0, 20.0],
};

/// Two moving hands, palms up; a throw from hand 2 to hand 1.
pub static CATCH_UNDERARM: Layout = Layout {
    name: "catch_underarm",
    mounts: &[
        mount([1.0, 1.35, 0.35], PALM_UP_1),
        mount([1.0, 0.0, 0.35], PALM_UP_2),
    ],
    moving: true,
    floor: -1.0,
    view: view([1.0, 0.675, 0.38], 1.45, 35.0),
    places: &[place([1.0, 0.35, 0.4], [1.0, 0.7, 0.2])],
    turned_targets: true,
    beginning: Beginning::Settled,
    goals: [
        region([0.9, 0.33, 0.1], [1.1, 0.5, 0.4]),
        region([0.9, 0.85, 0.1], [1.1, 1.02, 0.4]),
    ],
    reward: CATCH_REWARD,
};

/// As [`CATCH_UNDERARM`], farther apart.
pub static CATCH_UNDERARM_HARD: Layout = Layout {
    name: "catch_underarm_hard",
    mounts: &[
        mount([1.0, 1.65, 0.35], PALM_UP_1),
        mount([1.0, -0.3, 0.35], PALM_UP_2),
    ],
    moving: true,
    floor: -1.0,
    view: view([1.0, 0.675, 0.38], 2.05, 35.0),
    places: &[place([1.0, 0.05, 0.4], [1.0, 0.7, 0.2])],
    turned_targets: true,
    beginning: Beginning::Settled,
    goals: [
        region([0.97, 0.08, 0.15], [1.03, 0.15, 0.35]),
        region([0.97, 1.2, 0.15], [1.03, 1.27, 0.35]),
    ],
    reward: CATCH_REWARD,
};

/// Two moving hands held upright; hand 2 holds the object behind its fingers.
pub static CATCH_OVERARM: Layout = Layout {
    name: "catch_overarm",
    mounts: &[
        mount([1.0, 1.35, 0.15], UPRIGHT_1),
        mount([1.0, 0.0, 0.15], UPRIGHT_2),
    ],
    moving: true,
    floor: -1.0,
    view: view([1.0, 0.6, 0.42], 1.95, 15.0),
    places: &[place([1.0, 1.3, 0.45], [1.0, 0.7, 0.2])],
    turned_targets: false,
    beginning: Beginning::Poised([1.0, -0.2, 0.40267]),
    goals: [
        region([0.9, -0.05, 0.4], [1.1, 0.05, 0.5]),
        region([0.9, 1.25, 0.4], [1.1, 1.35, 0.5]),
    ],
    reward: CATCH_REWARD,
};

/// As [`CATCH_UNDERARM`], with an object in each hand: they change hands.
pub static TWO_CATCH_UNDERARM: Layout = Layout {
    name: "two_catch_underarm",
    mounts: CATCH_UNDERARM.mounts,
    moving: true,
    floor: -1.0,
    view: CATCH_UNDERARM.view,
    places: &[
        place([1.0, 0.35, 0.4], [1.0, 0.7, 0.2]),
        place([1.0, 1.0, 0.4], [1.0, 0.7, 0.4]),
    ],
    turned_targets: false,
    beginning: Beginning::Settled,
    goals: [
        region([0.97, 0.38, 0.15], [1.03, 0.45, 0.35]),
        region([0.97, 0.9, 0.15], [1.03, 0.97, 0.35]),
    ],
    reward: CATCH_REWARD,
};

/// Joint positions of both hands with which an overarm throw begins: hand 1 waits open, hand 2 is drawn
/// back with bent fingers.
pub const POISED: [f64; 60] = [
    -1.69092e-16,
    1.28969e-13,
    -0.0983158,
    0.00671436,
    8.81387e-05,
    -6.18241e-07, //
    0.00953895,
    0.00197672,
    0.000177327,
    0.00967983,
    0.00965064,
    0.0203301, //
    0.000178503,
    0.0096801,
    0.00965076,
    0.0203529,
    0.000178503,
    0.00968019, //
    0.00965077,
    0.0203259,
    0.00969491,
    0.000176805,
    0.00967987,
    0.00965127, //
    0.021756,
    -0.000176283,
    0.00969183,
    0.000157871,
    0.00720181,
    -0.00959593, //
    1.52536e-12,
    2.07967e-12,
    -0.0983158,
    -0.438026,
    6.86275e-06,
    3.1689e-06, //
    -0.111061,
    -0.688919,
    -0.00154806,
    0.0115532,
    0.746703,
    0.994549, //
    -0.0971119,
    0.201292,
    0.777997,
    0.885088,
    -0.0269409,
    0.0686252, //
    0.903907,
    1.11351,
    0.00921815,
    -0.00116265,
    0.00948305,
    1.32187, //
    1.56106,
    -0.322045,
    0.199435,
    0.0400855,
    -0.51436,
    -1.41563,
];
