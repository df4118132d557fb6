"""What a run tells when it ends: for people, for programs, as a page."""
