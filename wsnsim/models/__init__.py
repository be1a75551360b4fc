"""Physics and policy: what the world is like and what the nodes have agreed on. Pure, frozen, vectorised."""
