"""The paper's figures, a study each."""
