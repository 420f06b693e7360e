//! Pixels whose first samples found nothing.
