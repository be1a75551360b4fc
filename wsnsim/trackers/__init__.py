"""One tracking strategy a file; none knows another. What several of them need is in `shared`."""
