//! The catalogue: every effect that a rig may name.

use super::kind::EffectKind;
use std::sync::Arc;

/// The effects that a rig may name.
#[derive(Clone, Debug)]
pub struct Catalogue {
    kinds: Arc<[&'static EffectKind]>,
}

impl Catalogue {
    /// The effects of this crate.
    pub fn standard() -> Catalogue {
        Catalogue {
            kinds: super::STANDARD.into(),
        }
    }

    /// No effect.
    pub fn empty() -> Catalogue {
        Catalogue {
            kinds: Arc::default(),
        }
    }

    /// This catalogue with one effect more, in the place of one of the same name if there is one.
    #[must_use]
    pub fn with(self, kind: &'static EffectKind) -> Catalogue {
        let mut kinds: Vec<_> = self.kinds().collect();
        match kinds.iter_mut().find(|known| known.name == kind.name) {
            Some(same) => *same = kind,
            None => kinds.push(kind),
        }
        Catalogue {
            kinds: kinds.into(),
        }
    }

    /// Every effect, subsystem by subsystem.
    pub fn kinds(&self) -> impl Iterator<Item = &'static EffectKind> + Clone + use<> {
        let kinds = Arc::clone(&self.kinds);
        (0..kinds.len()).map(move |index| kinds[index])
    }

    /// The effect of that name.
    pub fn find(&self, name: &str) -> Option<&'static EffectKind> {
        self.kinds().find(|kind| kind.name == name)
    }
}
