//! The enabling device: a switch with three positions in the hand that is not at the lever. Its
//! contact is closed in the middle position only; a hand that lets go or clenches opens it (IEC
//! 60947-5-8). A rig has one if its settings say so.

use crate::io::Request;
use crate::supervisor::Mode;

/// Ticks for which the contact must be closed: contacts bounce for some milliseconds.
const CLOSED_TICKS: u8 = 3;
/// Ticks for which it must be open: shorter than any release, longer than an interference.
const OPEN_TICKS: u8 = 2;

/// The contact, debounced.
#[derive(Clone, Copy, Debug, Default)]
pub struct Enabling {
    is_closed: bool,
    /// Ticks for which the contact has differed from `is_closed`.
    differing_ticks: u8,
    /// It was open since the last motion: a contact that is welded, or a switch that is tied down,
    /// begins nothing.
    was_open: bool,
}

impl Enabling {
    /// The request that is left of `request` in this mode. Without the contact nothing begins, and
    /// what moves the weight is let down; venting, holding and the emergency stop need no contact.
    pub fn allow(&mut self, is_closed: bool, mode: Mode, request: Request) -> Request {
        self.debounce(is_closed);
        match mode {
            Mode::SelfCheck | Mode::Venting => self.was_open = !self.is_closed,
            Mode::Ready => self.was_open |= !self.is_closed,
            Mode::Assisting | Mode::Holding | Mode::Playing => {}
        }
        let moves = matches!(mode, Mode::Assisting | Mode::Holding | Mode::Playing);
        match request {
            Request::Stop | Request::StopContactsDiffer | Request::Vent => request,
            _ if moves && !self.is_closed => Request::Vent,
            Request::Assist | Request::Play(_) if moves => request,
            Request::Assist | Request::Play(_) if self.is_closed && self.was_open => request,
            Request::Reset if self.is_closed => request,
            Request::Assist | Request::Play(_) | Request::Reset => Request::None,
            Request::None | Request::Hold => request,
        }
    }

    fn debounce(&mut self, is_closed: bool) {
        self.differing_ticks = if is_closed == self.is_closed {
            0
        } else {
            self.differing_ticks.saturating_add(1)
        };
        let ticks = if is_closed { CLOSED_TICKS } else { OPEN_TICKS };
        if self.differing_ticks >= ticks {
            self.is_closed = is_closed;
            self.differing_ticks = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BEGINNINGS: [Request; 2] = [Request::Assist, Request::Play(1000)];

    /// What is left of a request after `ticks` with the contact like that.
    fn after(enabling: &mut Enabling, closed: bool, mode: Mode, request: Request) -> Request {
        (0..5).fold(Request::None, |_, _| enabling.allow(closed, mode, request))
    }

    #[test]
    fn nothing_begins_without_the_contact() {
        for request in BEGINNINGS {
            let mut enabling = Enabling::default();
            assert_eq!(
                after(&mut enabling, false, Mode::Ready, request),
                Request::None
            );
            assert_eq!(after(&mut enabling, true, Mode::Ready, request), request);
        }
        let mut enabling = Enabling::default();
        let reset = Request::Reset;
        assert_eq!(
            after(&mut enabling, false, Mode::Venting, reset),
            Request::None
        );
        assert_eq!(after(&mut enabling, true, Mode::Venting, reset), reset);
    }

    #[test]
    fn contact_that_never_opens_begins_nothing() {
        for request in BEGINNINGS {
            let mut enabling = Enabling::default();
            for mode in [Mode::Venting, Mode::SelfCheck, Mode::Ready] {
                assert_eq!(after(&mut enabling, true, mode, request), Request::None);
            }
            after(&mut enabling, false, Mode::Ready, request);
            assert_eq!(after(&mut enabling, true, Mode::Ready, request), request);
        }
    }

    #[test]
    fn letting_go_lets_the_weight_down_in_the_second_tick() {
        for mode in [Mode::Assisting, Mode::Holding, Mode::Playing] {
            let mut enabling = Enabling::default();
            after(&mut enabling, true, mode, Request::None);
            for request in [
                Request::None,
                Request::Assist,
                Request::Hold,
                Request::Play(9),
            ] {
                after(&mut enabling, true, mode, request);
                assert_eq!(enabling.allow(false, mode, request), request);
                assert_eq!(enabling.allow(false, mode, request), Request::Vent);
            }
        }
    }

    #[test]
    fn stopping_and_venting_need_no_contact() {
        for request in [Request::Vent, Request::Stop, Request::StopContactsDiffer] {
            for (mode, _) in Mode::NAMED {
                for closed in [false, true] {
                    let left = Enabling::default().allow(closed, *mode, request);
                    assert_eq!(left, request, "{mode:?}");
                }
            }
        }
    }
}
