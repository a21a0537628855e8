//! Places for connections: so many in all, and so many for each address, so that nobody has them
//! all. IPv6 addresses count by their /64 network: whoever has one has all of them.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Arc, Mutex, PoisonError};

/// Which limit leaves no place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Full {
    /// That of all connections.
    All,
    /// That of the address.
    Address,
}

impl Full {
    /// The limit's name in metrics.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Address => "address",
        }
    }
}

#[derive(Default)]
struct Taken {
    all: u64,
    by_address: HashMap<IpAddr, u64>,
}

/// The places that are taken, counted.
#[derive(Clone)]
pub struct Places {
    taken: Arc<Mutex<Taken>>,
    most: u64,
    most_each: u64,
}

/// A place, until dropped.
pub struct Place {
    places: Places,
    address: IpAddr,
}

impl Places {
    /// So many places, and so many for each address.
    pub fn new(most: u64, most_each: u64) -> Self {
        Self { taken: Arc::default(), most, most_each }
    }

    /// A place for a connection from that address.
    ///
    /// # Errors
    /// Which limit leaves none.
    pub fn take(&self, address: IpAddr) -> Result<Place, Full> {
        let address = network(address);
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        if taken.all >= self.most {
            return Err(Full::All);
        }
        let own = taken.by_address.entry(address).or_default();
        if *own >= self.most_each {
            return Err(Full::Address);
        }
        *own += 1;
        taken.all += 1;
        drop(taken);
        Ok(Place { places: self.clone(), address })
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut taken = self.places.taken.lock().unwrap_or_else(PoisonError::into_inner);
        taken.all -= 1;
        if let Some(own) = taken.by_address.get_mut(&self.address) {
            *own -= 1;
            if *own == 0 {
                taken.by_address.remove(&self.address);
            }
        }
    }
}

/// The address itself, or the /64 network that it is in.
fn network(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) => {
            let [a, b, c, d, ..] = address.segments();
            Ipv6Addr::new(a, b, c, d, 0, 0, 0, 0).into()
        }
        address => address,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn address(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    #[test]
    fn no_address_has_all_places_and_each_comes_back() {
        let places = Places::new(3, 2);
        let one = address("192.0.2.1");
        let held = [places.take(one), places.take(one)];
        assert_eq!(places.take(one).err(), Some(Full::Address));
        // The same one, written as IPv6.
        assert_eq!(places.take(address("::ffff:192.0.2.1")).err(), Some(Full::Address));
        let other = places.take(address("192.0.2.2"));
        assert!(other.is_ok());
        assert_eq!(places.take(address("192.0.2.3")).err(), Some(Full::All));
        drop((held, other));
        let taken = places.taken.lock().unwrap();
        assert_eq!((taken.all, taken.by_address.len()), (0, 0));
    }

    #[test]
    fn a_network_of_ipv6_is_one_caller() {
        let places = Places::new(9, 1);
        let held = places.take(address("2001:db8:1:2::1"));
        assert!(held.is_ok());
        assert_eq!(places.take(address("2001:db8:1:2:ffff::9")).err(), Some(Full::Address));
        assert!(places.take(address("2001:db8:1:3::1")).is_ok());
    }
}
