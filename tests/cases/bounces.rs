//! Small bright spots that light a room.
