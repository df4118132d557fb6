"""Recordings of any kind as stores of messages, and what their messages say."""
