//! States of terms, and the list of terms of a subsystem.

/// The dynamics of a term: its states, driven by the inputs of its subsystem (`Point`).
///
/// Every method has a default, so that a term without states implements none. States are of two
/// kinds in one slice: continuous states have a rate; memory states (of a rate-independent
/// hysteresis, for example) have none and are updated by [`Dynamics::accept_step`] after each
/// accepted step. Within a step the motion is monotone, as the integrator locates reversals. States
/// are scaled to order one, to which the integrator's tolerance is relative.
pub trait Dynamics<Point> {
    /// How many states the term has.
    fn states(&self) -> usize {
        0
    }

    /// Sets the states to their values after a long rest at `point`.
    fn steady_state(&self, _at: &Point, _state: &mut [f64]) {}

    /// Sets a memory that a rest does not erase to its value after a motion: `share` is 1 after a
    /// long contraction, −1 after a long extension, and between them in proportion.
    fn bias_memory(&self, _at: &Point, _share: f64, _state: &mut [f64]) {}

    /// Rates of the continuous states \[1/s\]; `rates` is 0 on entry.
    fn rates(&self, _at: &Point, _state: &[f64], _rates: &mut [f64]) {}

    /// Updates the memory after an accepted step that ended at `point`.
    fn accept_step(&self, _at: &Point, _state: &mut [f64]) {}

    /// Propagates the states over an interval in which all inputs of the term are known and change
    /// linearly `from` one instant `to` another: the result of integrating the rates, without its
    /// cost. A term of muscle or sensors that has rates must implement it.
    fn propagate(&self, _from: &Point, to: &Point, state: &mut [f64]) {
        self.accept_step(to, state);
    }
}

/// The terms of one subsystem, each with the position of its states in the state of the plant.
pub struct Terms<T: ?Sized> {
    slots: Vec<Slot<T>>,
}

struct Slot<T: ?Sized> {
    term: Box<T>,
    first: usize,
    states: usize,
}

impl<T: ?Sized> Default for Terms<T> {
    fn default() -> Self {
        Terms { slots: Vec::new() }
    }
}

impl<T: ?Sized> Terms<T> {
    /// Adds a term with its states from index `first` of the plant's state; returns their number.
    pub fn push<Point>(&mut self, term: Box<T>, first: usize) -> usize
    where
        T: Dynamics<Point>,
    {
        let states = term.states();
        self.slots.push(Slot {
            term,
            first,
            states,
        });
        states
    }

    /// Whether the subsystem is nominal.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    /// Whether any term has states.
    #[inline]
    pub fn have_states(&self) -> bool {
        self.slots.iter().any(|slot| slot.states > 0)
    }

    /// The terms.
    pub fn all(&self) -> impl Iterator<Item = &T> {
        self.slots.iter().map(|slot| &*slot.term)
    }

    /// The terms that have no states.
    pub fn without_states(&self) -> impl Iterator<Item = &T> {
        let slots = self.slots.iter().filter(|slot| slot.states == 0);
        slots.map(|slot| &*slot.term)
    }

    /// Each term with its states.
    #[inline]
    pub fn iter<'a>(&'a self, state: &'a [f64]) -> impl Iterator<Item = (&'a T, &'a [f64])> {
        self.slots.iter().map(move |slot| {
            // A caller without a state may use terms without states.
            let states = match slot.states {
                0 => &[],
                states => &state[slot.first..slot.first + states],
            };
            (&*slot.term, states)
        })
    }

    /// Writes the rates of the terms' states into `rates`, at the positions of the states.
    #[inline]
    pub fn rates<Point>(&self, point: &Point, state: &[f64], rates: &mut [f64])
    where
        T: Dynamics<Point>,
    {
        for slot in self.slots.iter().filter(|slot| slot.states > 0) {
            let range = slot.first..slot.first + slot.states;
            slot.term
                .rates(point, &state[range.clone()], &mut rates[range]);
        }
    }

    /// Propagates the terms' states from one instant to another.
    pub fn propagate<Point>(&self, from: &Point, to: &Point, state: &mut [f64])
    where
        T: Dynamics<Point>,
    {
        for slot in self.slots.iter().filter(|slot| slot.states > 0) {
            let range = slot.first..slot.first + slot.states;
            slot.term.propagate(from, to, &mut state[range]);
        }
    }

    /// Updates the terms' states in one of the ways of [`Update`].
    pub fn update<Point>(&self, how: Update, point: &Point, state: &mut [f64])
    where
        T: Dynamics<Point>,
    {
        for slot in self.slots.iter().filter(|slot| slot.states > 0) {
            let states = &mut state[slot.first..slot.first + slot.states];
            match how {
                Update::SteadyState => slot.term.steady_state(point, states),
                Update::BiasMemory(share) => slot.term.bias_memory(point, share, states),
                Update::AcceptStep => slot.term.accept_step(point, states),
            }
        }
    }
}

/// An update of the states of all terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Update {
    /// [`Dynamics::steady_state`].
    SteadyState,
    /// [`Dynamics::bias_memory`] with this share.
    BiasMemory(f64),
    /// [`Dynamics::accept_step`].
    AcceptStep,
}
