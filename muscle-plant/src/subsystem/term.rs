//! What every effect term may bring along besides its contribution to a block.

/// The dynamics of a term: states of its own, driven by what its block sees (`Point`).
///
/// Everything has a default, so that a term without states implements nothing. States are of two
/// kinds and share one slice: continuous ones have a rate; memory (of a rate-independent
/// hysteresis, say) has none and is renewed by [`Dynamics::accept_step`] after each accepted step,
/// between which the motion is monotone: reversals are located by the integrator. States are scaled
/// to order one: the integrator's tolerance is relative to that.
pub trait Dynamics<Point> {
    /// How many states the term has.
    fn states(&self) -> usize {
        0
    }

    /// Sets the states to what they are after a long rest at `at`.
    fn steady_state(&self, _at: &Point, _state: &mut [f64]) {}

    /// Where the memory of a motion stays through a rest, sets it to what it is after one that
    /// went, relative to its reach, by `share` contracting (to 1) or paying out (to −1).
    fn bias_memory(&self, _at: &Point, _share: f64, _state: &mut [f64]) {}

    /// Rates of the continuous states \[1/s\]; `rates` comes in zeroed.
    fn rates(&self, _at: &Point, _state: &[f64], _rates: &mut [f64]) {}

    /// Renews the memory after an accepted step that ended at `at`.
    fn accept_step(&self, _at: &Point, _state: &mut [f64]) {}

    /// Takes the states on where all that the term sees is an input, and goes straight `from` one
    /// instant `to` another: what integrating the rates would give, without its cost. A term of
    /// muscle or sensors that has rates must have its own.
    fn propagate(&self, _from: &Point, to: &Point, state: &mut [f64]) {
        self.accept_step(to, state);
    }
}

/// The terms of one block, each with its place in the plant's state.
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
    /// Adds a term whose states begin at `first` of the plant's state; returns how many it has.
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

    /// True where the block is nominal.
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

    /// Each term with its own states.
    #[inline]
    pub fn iter<'a>(&'a self, state: &'a [f64]) -> impl Iterator<Item = (&'a T, &'a [f64])> {
        self.slots.iter().map(move |slot| {
            // A term without states may be asked without a state at hand.
            let own = match slot.states {
                0 => &[],
                states => &state[slot.first..slot.first + states],
            };
            (&*slot.term, own)
        })
    }

    /// Writes the rates of the terms' states into their places of `rates`.
    #[inline]
    pub fn rates<Point>(&self, at: &Point, state: &[f64], rates: &mut [f64])
    where
        T: Dynamics<Point>,
    {
        for slot in self.slots.iter().filter(|slot| slot.states > 0) {
            let own = slot.first..slot.first + slot.states;
            slot.term.rates(at, &state[own.clone()], &mut rates[own]);
        }
    }

    /// Takes the terms' states on from one instant to another.
    pub fn propagate<Point>(&self, from: &Point, to: &Point, state: &mut [f64])
    where
        T: Dynamics<Point>,
    {
        for slot in self.slots.iter().filter(|slot| slot.states > 0) {
            let own = slot.first..slot.first + slot.states;
            slot.term.propagate(from, to, &mut state[own]);
        }
    }

    /// Settles the terms' states, leans them, or renews their memory.
    pub fn update<Point>(&self, how: Update, at: &Point, state: &mut [f64])
    where
        T: Dynamics<Point>,
    {
        for slot in self.slots.iter().filter(|slot| slot.states > 0) {
            let own = &mut state[slot.first..slot.first + slot.states];
            match how {
                Update::SteadyState => slot.term.steady_state(at, own),
                Update::BiasMemory(share) => slot.term.bias_memory(at, share, own),
                Update::AcceptStep => slot.term.accept_step(at, own),
            }
        }
    }
}

/// What is done to the states of all terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Update {
    /// [`Dynamics::steady_state`].
    SteadyState,
    /// [`Dynamics::bias_memory`], by this share.
    BiasMemory(f64),
    /// [`Dynamics::accept_step`].
    AcceptStep,
}
