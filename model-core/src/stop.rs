//! The emergency stop: two contacts that are closed while the device may be used, each on a wire of
//! its own. An open wire looks like an open contact.

use crate::io::Request;

/// Ticks for which a contact must be open: shorter than a contact is pressed, longer than an
/// interference.
const OPEN_TICKS: u8 = 2;
/// Ticks for which the contacts may differ: 0.5 s, in which a slow hand opens or closes both.
const DIFFER_TICKS: u8 = 50;

/// The contacts, debounced.
#[derive(Clone, Copy, Debug, Default)]
pub struct StopContacts {
    /// Ticks for which a contact has been open, and for which the two have differed.
    open_ticks: u8,
    differ_ticks: u8,
}

impl StopContacts {
    /// What the contacts demand.
    pub fn request(&mut self, open: [bool; 2]) -> Request {
        let count = |ticks: u8, counts: bool| if counts { ticks.saturating_add(1) } else { 0 };
        self.open_ticks = count(self.open_ticks, open != [false; 2]);
        self.differ_ticks = count(self.differ_ticks, open[0] != open[1]);
        if self.differ_ticks >= DIFFER_TICKS {
            Request::StopContactsDiffer
        } else if self.open_ticks >= OPEN_TICKS {
            Request::Stop
        } else {
            Request::None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn requests(open: [bool; 2], ticks: usize) -> Vec<Request> {
        let mut contacts = StopContacts::default();
        (0..ticks).map(|_| contacts.request(open)).collect()
    }

    #[test]
    fn closed_contacts_demand_nothing() {
        assert_eq!(requests([false; 2], 1000), [Request::None; 1000]);
    }

    #[test]
    fn either_contact_stops_in_the_second_tick() {
        for open in [[true, true], [true, false], [false, true]] {
            assert_eq!(requests(open, 2), [Request::None, Request::Stop]);
        }
    }

    #[test]
    fn an_interference_of_one_tick_does_not_stop() {
        let mut contacts = StopContacts::default();
        for tick in 0..1000 {
            let open = [tick % 2 == 0, tick % 2 == 0];
            assert_eq!(contacts.request(open), Request::None);
        }
    }

    #[test]
    fn contacts_that_differ_for_half_a_second_are_broken() {
        for open in [[true, false], [false, true]] {
            let requests = requests(open, 60);
            assert_eq!(requests[48], Request::Stop);
            assert_eq!(requests[49..], [Request::StopContactsDiffer; 11]);
        }
        assert!(!requests([true; 2], 1000).contains(&Request::StopContactsDiffer));
    }
}
