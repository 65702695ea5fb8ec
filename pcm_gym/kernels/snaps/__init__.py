"""What happens where stability is lost: overdamped motion of whole rods to where they come to rest."""
