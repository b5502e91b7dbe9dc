"""What this computer can do: error against run time, growth of cost, memory, its floor."""
