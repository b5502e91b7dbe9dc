"""What this computer can do: error against run time, growth, memory, the machine's floor."""
